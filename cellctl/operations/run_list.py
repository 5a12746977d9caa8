"""A run in figures (JSON: that of `cellctl show`), and how it ended early."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Self, final

from pydantic import SerializerFunctionWrapHandler, model_serializer

from cellctl.files import InputError
from cellctl.journal import JournalError, Outcome, RunEnded, RunResult, RunState, fold, read_journal, writer_of
from cellctl.journal.journal_file import FILE_NAME
from cellctl.operations.run_folder import ACCEPTANCE_NAME, OUTPUT_NAME, never_began, table_line
from cellctl.records import Figures, Json

_FAILED = (Outcome.FAILED, Outcome.TIMED_OUT)
_HEADS = {"uncertain": "Uncertain state, look at the cell"}
_NOT_CLEAN = "the clean-up did not succeed"
_CURE = "    "
"""So begins a line of an error's text that says what to do."""

UNREADABLE = "unreadable"
"""State of a run of whose journal nothing can be read."""

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


ROBOT = "robot"
"""Name of the robot among a cell's devices."""

_UNWRITTEN = ("run", "began", "state", "procedure", "sentence", "problem", "cure", "note")
"""What can be known of a run without a readable journal, in the order of its JSON."""


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class RunSummary:
    """A run, in the order of its JSON, in which the fields of `section` are among the others.

    Of an unreadable run `run`, `began`, `state` (`unreadable`) and `sentence` are known; of one without a journal
    (`not begun`) `procedure`, `problem` and `cure` too. began: UTC, ISO 8601. procedure, cell: paths of the files.
    devices: identities by name. before, after: measured held-out errors, mm. acceptance: the decision on
    their limit, as the report in the folder states it; None without a limit or report. table: the one that was pushed.
    section: what only this kind of campaign has. cell_s: duration in the cell's time, s. note: in a
    list, that the folder vanished, was renamed or copied.
    """

    run: str
    began: str | None = None
    procedure: str | None = None
    cell: str | None = None
    simulated: bool = False
    operator: str | None = None
    devices: Mapping[str, Mapping[str, Json]] = field(default_factory=dict)
    state: str
    points: int | None = None
    attempts: int | None = None
    verdict: str | None = None
    before: Figures | None = None
    after: Figures | None = None
    acceptance: Mapping[str, Json] | None = None
    table: Mapping[str, Json] | None = None
    sentence: str | None = None
    problem: str | None = None
    cure: str | None = None
    table_state: str | None = None
    table_words: str | None = None
    process: str | None = None
    section: Mapping[str, Json] = field(default_factory=dict)
    lines: tuple[str, ...] = ()
    reason: str | None = None
    cell_s: float | None = None
    seed: int | None = None
    clock: str | None = None
    note: str | None = None

    @model_serializer(mode="wrap")
    def _flat(self, handler: SerializerFunctionWrapHandler) -> dict[str, Json]:
        content = handler(self)
        if self.note is None:
            del content["note"]
        if self.cell_s is None:
            return {name: content[name] for name in _UNWRITTEN if content.get(name) is not None}
        parts = (part if name == "section" else {name: part} for name, part in content.items())
        return {name: value for part in parts for name, value in part.items()}

    @classmethod
    def of_json(cls, content: Mapping[str, Json], note: str | None = None) -> Self:
        """The inverse of its JSON, of which what is no field of its own is the section; with another note."""
        own = {each.name for each in fields(cls)}
        known = {name: value for name, value in content.items() if name in own}
        errors = {name: Figures(**known[name]) for name in ("before", "after") if known.get(name)}
        section = {name: value for name, value in content.items() if name not in own}
        known |= {**errors, "lines": tuple(known.get("lines", ())), "note": note}
        return cls(**known, section=section)

    @property
    def serial(self) -> str:
        """Serial of the run's robot, as it reported it; empty if none was connected."""
        return str(self.devices.get(ROBOT, {}).get("serial", ""))

    @property
    def accepted(self) -> str:
        """The decision on the acceptance limit: `accepted`, `rejected` or `no decision`; empty without one."""
        return str((self.acceptance or {}).get("decision", ""))

    @property
    def procedure_name(self) -> str:
        """Name of the run's procedure: its file's, without suffix; empty without one."""
        return Path(self.procedure or "").stem


def run_summary(place: Path, state: RunState) -> RunSummary:
    """The run in folder `place`, whose journal has the state `state`."""
    result = RunResult.of(place.name, state)
    writer = writer_of(place)
    end = RunEnd.of(place, state, running=bool(writer))
    started = state.started
    return RunSummary(
        run=place.name,
        began=started.calendar if started else None,
        procedure=started.procedure.path if started else None,
        cell=started.cell.path if started else None,
        simulated=is_simulated(state),
        operator=started.operator if started else None,
        devices=state.identities,
        state=state.state_if(running=bool(writer)),
        points=result.points,
        attempts=sum(step.attempt for step in state.steps.values()),
        verdict=result.verdict,
        before=result.before,
        after=result.after,
        acceptance=_acceptance(place, state.last_seq),
        table=result.table_data,
        sentence=result.sentence or (end.sentence if end else None),
        problem=end.problem if end else None,
        cure=end.cure if end else None,
        table_state=result.table.state if result.table else None,
        table_words=table_line(state, place) or None,
        process=writer.pid if writer else None,
        section=result.section,
        lines=result.lines,
        reason=state.ended.reason if state.ended else None,
        cell_s=round((state.last_ns - state.first_ns) * 1e-9, 3),
        seed=started.seed if started else None,
        clock=started.clock if started else None,
    )


def _acceptance(place: Path, last_event: int) -> Mapping[str, Json] | None:
    """From the file beside the report, unless the run went on since."""
    try:
        content = json.loads((place / ACCEPTANCE_NAME).read_bytes())
        decided = content.pop("last_event") == last_event
    except (OSError, ValueError, AttributeError, TypeError, KeyError):
        return None
    return content if decided else None


_RUN = re.compile(r".+-\d{8}T\d{6}Z(-\d+)?")
"""Name of a run's folder, as `new_run_folder` makes it."""


def run_row(place: Path) -> RunSummary:
    """The run in the folder `place`, by its journal."""
    return run_row_and_state(place)[0]


def run_row_and_state(place: Path) -> tuple[RunSummary, RunState | None]:
    """The run in the folder `place`, and the state of its journal; None if that is unreadable."""
    try:
        state = fold(read_journal(place / FILE_NAME))
    except (JournalError, InputError) as error:
        return _unreadable(place, error.what if isinstance(error, JournalError) else str(error)), None
    row = run_row_of(place, state)
    return row, None if row.state == UNREADABLE else state


def run_row_of(place: Path, state: RunState) -> RunSummary:
    """The run in the folder `place`, whose journal has the state `state`; unreadable if its rows are."""
    try:
        return run_summary(place, state)
    except InputError as error:  # rows of another version
        return _unreadable(place, str(error))
    except Exception as error:  # of a journal that another program wrote
        logging.getLogger(__name__).error("%s cannot be summarised", place, exc_info=error)
        return _unreadable(place, f"it cannot be shown: {type(error).__name__}: {error}")


def _unreadable(place: Path, why: str) -> RunSummary:
    return RunSummary(run=place.name, began=_changed(place / FILE_NAME), state=UNREADABLE, sentence=why)


def unborn_row(place: Path) -> RunSummary | None:
    """The run without a journal in the folder `place`, which has the name of the procedure, and its time.

    None if it is none, or not a run's folder. Raises OSError.
    """
    if not (_RUN.fullmatch(place.name) and never_began(place)):
        return None
    output = place / OUTPUT_NAME
    said = output.read_text(encoding="utf-8", errors="replace").strip() if output.is_file() else ""
    return RunSummary(
        run=place.name,
        began=_changed(place),
        state="not begun",
        procedure=place.name.rpartition("Z")[0].rpartition("-")[0],
        sentence="It has no journal: it ended before it began, or is beginning. Nothing was moved.",
        problem=said.removeprefix("cellctl: ") or "it ended before it began",
        cure="start it again",
    )


def _changed(path: Path) -> str:
    return datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def words_of(row: RunSummary) -> str:
    """What a search by words looks in, in lower case."""
    own = (row.run, row.began, row.procedure, row.cell, row.operator, row.state, row.verdict, row.sentence)
    table = (row.accepted, row.table_state, (row.table or {}).get("id"))
    devices = (part for device in row.devices.values() for part in device.values())
    return " ".join(str(part) for part in (*own, *table, *devices) if part).casefold()
