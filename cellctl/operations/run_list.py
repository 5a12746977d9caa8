"""The runs of a folder as rows, and the search in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeAlias, final

from cellctl.files import InputError
from cellctl.journal import JournalError, fold, read_journal
from cellctl.journal.journal_file import FILE_NAME
from cellctl.operations.results import OUTPUT_NAME, never_began
from cellctl.operations.run_summary import run_summary

_RUN = re.compile(r".+-\d{8}T\d{6}Z(-\d+)?")
"""Name of a run's folder, as `new_run_folder` makes it."""

RunRow: TypeAlias = Mapping[str, Any]
"""A run as `run_summary` has it; of an unreadable one `run`, `began`, `state` (`unreadable`) and `sentence`;
of one without a journal (`not begun`) `procedure`, `problem` and `cure` too."""

ROBOT = "robot"
"""Name of the robot among a cell's devices."""


@final
@dataclass(frozen=True, slots=True)
class RunFilter:
    """What a search asks for; an empty field asks for nothing. Letters' case does not matter.

    text: words, all of which are in the run's name, files, operator, devices, state, verdict or sentence. state,
    verdict, serial (of the robot): whole. procedure: the name of its file without suffix. since, until: first and last
    day or instant of the begin, ISO 8601.
    """

    text: str = ""
    state: str = ""
    verdict: str = ""
    serial: str = ""
    procedure: str = ""
    since: str = ""
    until: str = ""

    def keeps(self, row: RunRow) -> bool:
        """Whether the run of `row` is what is asked for."""
        began = str(row.get("began") or "")
        return (
            all(word in _text(row) for word in self.text.casefold().split())
            and _same(self.state, row["state"])
            and _same(self.verdict, row.get("verdict"))
            and _same(self.serial, robot_serial(row))
            and _same(self.procedure, procedure_name(row))
            and (not self.since or began >= self.since)
            and (not self.until or (bool(began) and began[: len(self.until)] <= self.until))
        )


def run_rows(runs: Path, asked: RunFilter | None = None) -> list[RunRow]:
    """The runs in the folder `runs`, newest first; those that `asked` keeps. Raises OSError."""
    rows = [run_row(journal.parent) for journal in runs.glob(f"*/{FILE_NAME}")]
    rows += [_unborn(folder) for folder in runs.glob("*-*") if _RUN.fullmatch(folder.name) and never_began(folder)]
    return [row for row in newest_first(rows) if asked is None or asked.keeps(row)]


def run_row(place: Path) -> RunRow:
    """The run in the folder `place`."""
    journal = place / "journal.sqlite"
    try:
        return run_summary(place, fold(read_journal(journal)))
    except (JournalError, InputError) as error:
        sentence = error.what if isinstance(error, JournalError) else str(error)
        return {"run": place.name, "began": _changed(journal), "state": "unreadable", "sentence": sentence}


def _unborn(place: Path) -> RunRow:
    """A run without a journal; its folder has the name of the procedure, and its time."""
    output = place / OUTPUT_NAME
    said = output.read_text(encoding="utf-8", errors="replace").strip() if output.is_file() else ""
    return {
        "run": place.name,
        "began": _changed(place),
        "state": "not begun",
        "procedure": place.name.rpartition("Z")[0].rpartition("-")[0],
        "sentence": "It has no journal: it ended before it began, or is beginning. Nothing was moved.",
        "problem": said.removeprefix("cellctl: ") or "it ended before it began",
        "cure": "start it again",
    }


def _changed(path: Path) -> str:
    return datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def newest_first(rows: Iterable[RunRow]) -> list[RunRow]:
    """The rows by their begin, the last one first."""
    return sorted(rows, key=lambda row: (str(row.get("began") or ""), row["run"]), reverse=True)


def robot_serial(row: RunRow) -> str:
    """Serial of the run's robot, as it reported it; empty if none was connected."""
    return str(row.get("devices", {}).get(ROBOT, {}).get("serial", ""))


def procedure_name(row: RunRow) -> str:
    """Name of the run's procedure: its file's, without suffix; empty without one."""
    return Path(row.get("procedure") or "").stem


def _same(asked: str, found: object) -> bool:
    return not asked or asked.casefold() == str(found or "").casefold()


def _text(row: RunRow) -> str:
    names = ("run", "began", "procedure", "cell", "operator", "state", "verdict", "sentence", "table_state")
    devices = (part for device in row.get("devices", {}).values() for part in device.values())
    table = (row.get("table") or {}).get("id")
    return " ".join(str(part) for part in (*(row.get(name) for name in names), table, *devices) if part).casefold()
