"""The runs of a folder: one in figures and how it ended early (JSON of `cellctl show`), all as rows, their search."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self, TypeAlias, final

from cellctl.files import InputError
from cellctl.journal import JournalError, Outcome, RunEnded, RunResult, RunState, fold, read_journal, writer_of
from cellctl.journal.journal_file import FILE_NAME
from cellctl.operations.run_folder import OUTPUT_NAME, never_began, table_line

_FAILED = (Outcome.FAILED, Outcome.TIMED_OUT)
_HEADS = {"uncertain": "Uncertain state, look at the cell"}
_NOT_CLEAN = "the clean-up did not succeed"
_CURE = "    "
"""So begins a line of an error's text that says what to do."""

_CUT_OFF = "its process ended without an end of the run"
_UNKNOWN = "what the robot did last is not known: look at it before anything else moves"


@final
@dataclass(frozen=True, slots=True)
class RunEnd:
    """The end of a run that did not finish.

    state: the engine's, or `cut off while …`. error: its text, causes and cures line by line. steps: paths of the steps
    that failed. troubles: what the clean-up did not achieve. robot: its state; empty in older journals. table: of a
    table that was pushed; empty without one. again: how the run is continued. measurements: how many are recorded.
    """

    state: str
    error: str
    steps: tuple[str, ...]
    troubles: tuple[str, ...]
    robot: str
    table: str
    again: str
    measurements: int

    @classmethod
    def of(cls, folder: Path, state: RunState, *, running: bool) -> Self | None:
        """Of the run in `folder`; None as long as it is running, and if it finished."""
        if state.ended:
            return None if state.ended.state == "finished" else cls.of_event(folder, state, state.ended)
        if running or state.started is None:
            return None
        robot = _UNKNOWN if state.uncertain else ""
        return cls.of_event(folder, state, RunEnded(state.state_if(running=False), "", _CUT_OFF, robot=robot))

    @classmethod
    def of_event(cls, folder: Path, state: RunState, ended: RunEnded) -> Self:
        """By the event of its end, which a full disk may have kept out of the journal."""
        procedure = state.started.procedure.path if state.started else "PROCEDURE"
        acknowledged = " --acknowledge" * (ended.state == "uncertain" or state.uncertain)
        again = f"`cellctl run {procedure} --resume {folder.name}{acknowledged}`"
        return cls(
            state=ended.state,
            error=ended.reason or _NOT_CLEAN * (ended.state == "uncertain"),
            steps=tuple(step.step for step in state.steps.values() if step.outcome in _FAILED),
            troubles=ended.troubles,
            robot=ended.robot,
            table=table_line(state, folder),
            again=again,
            measurements=state.measurements,
        )

    @property
    def problem(self) -> str:
        """Every cause, in one line."""
        causes = [line for line in self.error.split("\n") if line and not line.startswith(_CURE)]
        found = ""
        for cause in [*causes, *self.troubles]:
            found += ("" if not found else " " if found.endswith(":") else "; ") + cause.partition("\n")[0].strip()
        return found

    @property
    def cure(self) -> str:
        """What to do, in one line: the cures of the causes, and how the run is continued."""
        lines = [line for text in (self.error, *self.troubles) for line in text.split("\n")]
        cures = [line.strip().removesuffix(".") for line in lines if line.startswith(_CURE)]
        return "; ".join(dict.fromkeys([*cures, f"continue it with {self.again}"]))

    @property
    def data(self) -> str:
        """What is recorded."""
        return f"{self.measurements} measurements are recorded"

    @property
    def sentence(self) -> str:
        """The headline: state, cause, cure, robot, table and data."""
        head = _HEADS.get(self.state, self.state.capitalize())
        first = f"{head}: {self.problem}" if self.problem else head
        return " ".join(_sentence(text) for text in (first, self.cure, self.robot, self.table, self.data) if text)

    def lines(self, folder: Path) -> list[str]:
        """For the terminal."""
        lines = [f"run {self.state}: {self.error}"]
        lines += [f"    in step {step}" for step in self.steps]
        lines += [f"    {text}" for text in (*self.troubles, self.robot, self.table) if text]
        return [*lines, f"    {self.data} in {folder}", f"    continue it with {self.again}"]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "?", "!")) else ".")


_SIMULATE = re.compile(r"^simulate\s*:", re.MULTILINE)


def is_simulated(state: RunState) -> bool:
    """Whether a device of the run reported that it is simulated, or its cell file has simulation settings."""
    reported = any(identity.get("simulated") for identity in state.identities.values())
    return reported or bool(state.started and _SIMULATE.search(state.started.cell.text))


def run_summary(place: Path, state: RunState) -> dict[str, Any]:
    """The run in folder `place`, whose journal has the state `state`."""
    result = RunResult.of(place.name, state)
    content = result.to_json()
    writer = writer_of(place)
    end = RunEnd.of(place, state, running=bool(writer))
    return {
        "run": place.name,
        "began": state.started.calendar if state.started else None,
        "procedure": state.started.procedure.path if state.started else None,
        "cell": state.started.cell.path if state.started else None,
        "simulated": is_simulated(state),
        "operator": state.started.operator if state.started else None,
        "devices": {name: dict(identity) for name, identity in state.identities.items()},
        "state": state.state_if(running=bool(writer)),
        "points": result.points,
        "attempts": sum(step.attempt for step in state.steps.values()),
        **{name: content[name] for name in ("verdict", "before", "after", "table")},
        "sentence": content["sentence"] or (end.sentence if end else None),
        "problem": end.problem if end else None,
        "cure": end.cure if end else None,
        "table_state": result.table.state if result.table else None,
        "table_words": table_line(state, place) or None,
        "process": writer.pid if writer else None,
        **result.section,
        "lines": result.lines,
        "reason": state.ended.reason if state.ended else None,
        "cell_s": round((state.last_ns - state.first_ns) * 1e-9, 3),
        "seed": state.started.seed if state.started else None,
        "clock": state.started.clock if state.started else None,
    }


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
