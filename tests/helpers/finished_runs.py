"""Run folders of finished campaigns, made in milliseconds: a journal with a verdict."""

from __future__ import annotations

from pathlib import Path

from cellctl.journal import DevicesConnected, Journal, Recorded, RunEnded, RunStarted, SourceFile, StateChanged
from cellctl.records import Figures, VerdictRow


def run_in(
    folder: Path,
    name: str,
    day: str,
    serial: str,
    verdict: str = "better",
    procedure: str = "sphere",
    cell: str = "hall7",
) -> Path:
    """The folder of a finished run of `procedure` on a robot, begun at 8:00 of `day`."""
    source, place = SourceFile(f"procedures/{procedure}.yaml", "", ""), SourceFile(f"{cell}.yaml", "", "")
    with Journal.create(folder / name, lambda: 0) as journal:
        journal.append(
            RunStarted(source, place, {}, 1, "lockstep", "Kim", f"{day}T08:00:00Z", "", {}, name=name, section=())
        )
        identity = {"serial": serial, "model": "KR5 R1400", "firmware": "8.6", "simulated": serial.startswith("SIM-")}
        journal.append(DevicesConnected({"robot": identity}))
        figures = Figures(1.0, 1.1, 2.0)
        journal.append(Recorded.of(VerdictRow(verdict, "Error at held-out targets.", figures, figures), "", 1))
        journal.append(StateChanged("running", "finished"))
        journal.append(RunEnded("finished", verdict))
    return folder / name
