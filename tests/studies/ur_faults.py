"""How a run on a UR ends for each fault that its simulated controller can have: state, message, exit code (5 minutes).

Runs touches on the UR10e cell, each time with one fault: before the first move, in a move, or in a search. Prints a
Markdown table. A study and no test: it judges nothing.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

from cellctl.journal import fold, read_journal
from tests.helpers.runs import ROOT, cellctl_process, faults, touches_procedure
from tests.studies._runner import Row, Study, Table, each

CELL = ROOT / "procedures" / "cells" / "ur10e_cell.yaml"
MOMENTS = {
    "before the first move": "",
    "in a move": ", event: robot.move, count: 12, after_ms: 300",
    "in a search": ", event: ur.speed, count: 3, after_ms: 300",
}
FAULTS = {
    "ur.drop": ", for_ms: 2000",
    "ur.stall": ", for_ms: 2000",
    "ur.slow": ", for_ms: 2000",
    "ur.protective_stop": "",
    "ur.stop": "",
    "ur.power_off": "",
    "ur.local": ", for_ms: 600000",
    "ur.reboot": "",
    "ur.second_client": ", for_ms: 600000",
    "ur.wrong_serial": ", for_ms: 600000",
    "ur.clock_jump": ", ms: 2000",
    "safety.emergency_stop": "",
    "safety.guard_open": "",
}
HEAD = "| fault | when | the run ends as | exit code | rest confirmed | message |\n|---|---|---|---|---|---|"


BEFORE = ("ur.protective_stop", "ur.power_off", "ur.local")
"""Those that can be there when a run begins. Connecting comes before: what is refused there is not among them."""


def measure(fault: str, moment: str) -> Row:
    """A run of six touches: exit code; of its journal state, robot and reason; the end of stderr."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        text = CELL.read_text().replace("../robots/", f"{ROOT}/procedures/robots/")
        text = text.replace("programs: ur10e_programs", f"programs: {CELL.parent}/ur10e_programs")
        cell = folder / "cell.yaml"
        cell.write_text(text.rstrip() + "\n" + faults(f"fault: {fault}{MOMENTS[moment]}{FAULTS[fault]}"))
        done = cellctl_process(
            "run", touches_procedure(folder), "--cell", cell, "--runs", folder / "runs", timeout=600.0
        )
        journals = [fold(read_journal(file.parent)) for file in (folder / "runs").glob("*/journal.sqlite")]
        ended = [journal.ended for journal in journals if journal.ended]
    return {
        "exit": done.returncode,
        "state": ended[0].state if ended else "",
        "robot": ended[0].robot if ended else "",
        "reason": ended[0].reason if ended else "",
        "touches": len(journals[0].data_of("touch")) if journals else 0,
        "stderr": done.stderr[-2000:],
    }


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """A line for each fault, and for each different end of its runs."""
    ends: dict[tuple[str, ...], list[str]] = {}
    for row in found:
        message = row["reason"].partition("\n")[0].removeprefix("robot: ")
        held = "yes" if "is held" in row["robot"] else "no"
        end = (row["fault"], row["state"] or "refused", str(row["exit"]), held, message)
        ends.setdefault(end, []).append(row["moment"])
    lines = [f"| `{fault}` | {', '.join(moments)} | {' | '.join(end)} |" for (fault, *end), moments in ends.items()]
    yield Table("\n".join([HEAD, *lines]), "UR faults")


def units(_: Namespace) -> Iterator[Row]:
    """Each fault at each moment at which it can begin."""
    return (
        unit
        for unit in each(fault=FAULTS, moment=MOMENTS)
        if unit["fault"] in BEFORE or unit["moment"] != "before the first move"
    )


STUDY = Study(units, measure, tables, writes=True)
