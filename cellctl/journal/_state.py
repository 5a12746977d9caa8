"""The state of a run, folded from its events: the basis of resume, show and runs; its result, and its pushed table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final, Self, final

from cellctl.files import InputError, Problem
from cellctl.journal.events import (
    DeviceHealth,
    DevicesConnected,
    Entry,
    Event,
    Outcome,
    Recorded,
    RunEnded,
    RunResumed,
    RunStarted,
    StateChanged,
    StepEnded,
    StepFailure,
    StepStarted,
)
from cellctl.records import AnyRow, BadRow, Figures, Json, Row, Rows, TablePushRow, TableStateRow, VerdictRow

_OLDER_MEASURED_KINDS: Final = frozenset({"touch"})
"""Row kinds that are measured points."""

_OLDER_SECTION: Final = ("held_out", "standoff", "drift", "stops")
"""The verdict's fields in the result besides the common ones."""


_UNCERTAIN = "DeviceUncertain"
"""The failure of a device whose stop, or last write, is not confirmed."""


@final
@dataclass(frozen=True, slots=True)
class StepState:
    """A step's latest attempt: its number, whether it moves, and how it ended (`outcome` None: in progress)."""

    step: str
    attempt: int
    moves: bool
    outcome: Outcome | None = None
    result: Any = None
    failure: StepFailure | None = None


@final
@dataclass(frozen=True, slots=True)
class RecordedRow:
    """A row as it was recorded: the event's number, the cell's time, and the event."""

    seq: int
    time_ns: int
    event: Recorded

    @property
    def measurement(self) -> bool:
        """Whether it is a measured point of the run."""
        said = self.event.measurement
        return self.event.row_kind in _OLDER_MEASURED_KINDS if said is None else said


@final
@dataclass(slots=True)
class RunState:
    """A run so far. `apply` adds one event; an engine may keep a state beside its journal.

    Of each step only the latest attempt counts, with its rows, if it is done or in progress: a row of
    a failed or interrupted attempt stays in the journal and is not counted.

    `operator`: who started it or resumed it last. `health`: device → what it reported last; `device_failures`: device →
    the last failure of an attempt that names it.
    `unconfirmed`: the step that moves, or whose device did not confirm a stop, and failed last, until its devices are
    known to stand; empty if there is none.
    """

    started: RunStarted | None = None
    ended: RunEnded | None = None
    state: str = "idle"
    calendar: str = ""
    operator: str = ""
    resumed: int = 0
    identities: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    health: dict[str, DeviceHealth] = field(default_factory=dict)
    device_failures: dict[str, StepFailure] = field(default_factory=dict)
    steps: dict[str, StepState] = field(default_factory=dict)
    rows: list[RecordedRow] = field(default_factory=list)
    last_seq: int = 0
    unconfirmed: str = ""
    first_ns: int = 0
    last_ns: int = 0
    _read: dict[tuple[int, type[Row]], Row] = field(default_factory=dict, repr=False, compare=False)

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The run's parameters; empty before its start."""
        return self.started.parameters if self.started else {}

    @property
    def name(self) -> str:
        """The run's name at its start; empty in older journals."""
        return self.started.name if self.started else ""

    @property
    def section(self) -> tuple[str, ...]:
        """The verdict's fields that only this kind of campaign has."""
        said = self.started.section if self.started else ()
        return _OLDER_SECTION if said is None else said

    @property
    def finished(self) -> dict[str, Any]:
        """The steps that are done, each with its result."""
        return {step.step: step.result for step in self.steps.values() if step.outcome is Outcome.DONE}

    @property
    def in_flight(self) -> tuple[StepState, ...]:
        """The steps in progress."""
        return tuple(step for step in self.steps.values() if step.outcome is None)

    @property
    def uncertain(self) -> bool:
        """Whether the engine recorded it, or a step that moves has begun and not ended, or failed and nothing confirms
        that its devices stand.

        This is normal while a process writes the run; otherwise a person has to check the cell.
        """
        failed = bool(self.unconfirmed) and self.ended is None
        return self.state == "uncertain" or failed or any(step.moves for step in self.in_flight)

    def next_attempt(self, step: str) -> int:
        """The number of the step's next attempt, from 1."""
        return self.steps[step].attempt + 1 if step in self.steps else 1

    def state_if(self, *, running: bool) -> str:
        """The state; `cut off while …` for a run that has no end and that no process is running."""
        return self.state if running or self.ended else f"cut off while {self.state}"

    @property
    def measurements(self) -> int:
        """How many measured points count."""
        return sum(row.measurement and self.counts(row) for row in self.rows)

    def recorded(self, kind: type[AnyRow]) -> list[AnyRow]:
        """The rows of this class that count, in the order of recording.

        Raises InputError, naming event, kind and field, if the journal's data do not fit the class.
        """
        mine = (row for row in self.rows if row.event.row_kind == kind.KIND and self.counts(row))
        return [self._as(kind, row) for row in mine]

    def all_recorded(self, *kinds: type[AnyRow]) -> list[AnyRow]:
        """The rows of these classes of every attempt, failed and interrupted ones included, in order.

        Raises InputError as `recorded`.
        """
        of = {kind.KIND: kind for kind in kinds}
        return [self._as(of[row.event.row_kind], row) for row in self.rows if row.event.row_kind in of]

    def last(self, kind: type[AnyRow]) -> AnyRow | None:
        """The last row of this class that counts; None if there is none. Raises InputError as `recorded`."""
        return next(reversed(self.recorded(kind)), None)

    def data_of(self, kind: str) -> list[Mapping[str, Any]]:
        """The rows of the kind with this name that count, as the journal holds them: for readers without its class."""
        return [row.event.data for row in self.rows if row.event.row_kind == kind and self.counts(row)]

    def counts(self, row: RecordedRow) -> bool:
        """Whether `row` counts: the engine's own always, a step's if of the latest attempt, done or in progress."""
        step = self.steps.get(row.event.step)
        if step is None:
            return not row.event.step
        return step.attempt == row.event.attempt and step.outcome in (None, Outcome.DONE)

    def _as(self, kind: type[AnyRow], row: RecordedRow) -> AnyRow:
        read = self._read.get((row.seq, kind))
        if read is None:
            try:
                read = kind.read(row.event.data, row.event.version)
            except BadRow as error:
                what = f"event {row.seq}, a row of kind '{kind.KIND}': {error}"
                cure = "read it with the cellctl that wrote it, or restore the run folder from a copy"
                raise InputError(Problem("journal", 0, 0, what, cure)) from error
            self._read[row.seq, kind] = read
        assert isinstance(read, kind)
        return read

    def apply(self, entry: Entry) -> None:
        """Apply the next event."""
        self.first_ns = self.first_ns if self.last_seq else entry.time_ns
        self.last_seq, self.last_ns = entry.seq, entry.time_ns
        if isinstance(entry.event, Recorded):
            self.rows.append(RecordedRow(entry.seq, entry.time_ns, entry.event))
        else:
            self._apply(entry.event)

    def _apply(self, event: Event) -> None:
        match event:
            case RunStarted():
                self.started, self.calendar, self.operator = event, event.calendar, event.operator
            case RunResumed():
                self._resume(event)
            case DevicesConnected(identities):
                self.identities = identities
            case DeviceHealth(device):
                self.health[device] = event
            case StateChanged(after=after):
                self.state = after
                if after == "paused":  # by then the engine has stopped the devices, or ended the run
                    self.unconfirmed = ""
            case StepStarted(step, attempt, moves):
                self._confirmed(moves)
                self.steps[step] = StepState(step, attempt, moves)
            case StepEnded():
                self._end(event)
            case RunEnded(state):
                self.ended, self.state = event, state
            case _:  # messages, operator actions and events of newer versions do not change the state
                pass

    def _end(self, event: StepEnded) -> None:
        moves = self.steps[event.step].moves if event.step in self.steps else False
        outcome, failure = event.outcome, event.failure
        if failure and (device := failure.text.partition(":")[0]) in self.identities:
            self.device_failures[device] = failure
        if outcome is Outcome.DONE:
            self._confirmed(moves)
        elif moves or (failure and failure.error == _UNCERTAIN):
            self.unconfirmed = event.step
        self.steps[event.step] = StepState(event.step, event.attempt, moves, outcome, event.result, failure)

    def _confirmed(self, moves: bool) -> None:
        """A step that moves begins, or is done: the engine knew that the devices stood. Clean-up steps run without."""
        if moves and self.state != "cleaning":
            self.unconfirmed = ""

    def _resume(self, event: RunResumed) -> None:
        self.ended, self.state, self.calendar, self.unconfirmed = None, "idle", event.calendar, ""
        self.resumed, self.operator = self.resumed + 1, event.operator
        for step in self.in_flight:
            self.steps[step.step] = replace(step, outcome=Outcome.INTERRUPTED)


def fold(entries: Iterable[Entry]) -> RunState:
    """The state after `entries`: a whole journal or its beginning."""
    state = RunState()
    for entry in entries:
        state.apply(entry)
    return state


@final
@dataclass(frozen=True, slots=True)
class PushedTable:
    """The table that a run pushed. row: the last one recorded of it; proved: the run's verdict on it is `better`."""

    row: TableStateRow
    proved: bool

    @classmethod
    def of(cls, run: Rows) -> Self | None:
        """From the rows of a run, including failed attempts; None if no table was pushed."""
        rows = run.all_recorded(TablePushRow, TableStateRow)
        if not rows:
            return None
        last = rows[-1]
        judged = [each.better for each in run.recorded(VerdictRow) if each.table and each.table.id == last.id]
        return cls(last, bool(judged) and judged[-1])

    @property
    def state(self) -> str:
        """`taken back`, `proved`, or `not proved, may be in force`."""
        if self.row.active is False:
            return "taken back"
        return "proved" if self.proved else "not proved, may be in force"

    @property
    def unproved_in_force(self) -> bool:
        """Whether it may be in force now although this run has not proved it."""
        return not self.proved and self.row.active is not False

    def words(self) -> str:
        """Its state, as a sentence without a full stop."""
        table = f"table {self.row.short}"
        if self.row.active is False:
            return f"{table} was rolled back: the table before it is in force again"
        if self.proved:
            return f"{table} is in force; this run proved it"
        return f"{table} was pushed by this run, is not proved, and may be in force on the controller"


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """The result of a run: the fields common to all campaigns, and the section of this kind.

    verdict, sentence, before, after, model: of the last verdict, None if there is none (see `VerdictRow`). points:
    measurements that count. table: the one that the run pushed. section: the fields of the campaign's own kind, each
    None if the run did not get that far. lines: for the operator, below the sentence. simulated_s: of the cell's
    time; wall_s: 0 if not measured.
    """

    run: str
    state: str
    verdict: str | None = None
    sentence: str | None = None
    points: int
    before: Figures | None = None
    after: Figures | None = None
    model: Mapping[str, Json] | None = None
    table: PushedTable | None
    section: Mapping[str, Json]
    error: str | None = None
    simulated_s: float
    wall_s: float = 0.0
    lines: tuple[str, ...] = ()

    @classmethod
    def of(cls, run: str, journal: RunState, **known: Any) -> Self:
        """The result of `run` (its name) by its `journal`; `known`: fields that the caller overrides."""
        verdict = journal.last(VerdictRow)
        content: Mapping[str, Json] = next(reversed(journal.data_of(VerdictRow.KIND)), {})
        common = ("verdict", "sentence", "before", "after", "model", "lines")
        found: dict[str, Any] = {
            "run": run,
            "state": journal.state,
            "points": journal.measurements,
            "table": PushedTable.of(journal),
            "section": {name: content.get(name) for name in journal.section},
            "simulated_s": (journal.last_ns - journal.first_ns) * 1e-9,
            **({name: getattr(verdict, name) for name in common} if verdict else {}),
        }
        return cls(**(found | known))

    @property
    def table_data(self) -> dict[str, Json] | None:
        """The table that the run pushed, with its state, as JSON has it."""
        return {**self.table.row.data(), "state": self.table.state} if self.table else None

    def to_json(self) -> dict[str, Json]:
        """As `cellctl run --json` prints it: the fields of the section follow the table."""
        content: dict[str, Json] = asdict(self)
        section, _ = content.pop("section"), content.pop("lines")
        content["table"] = self.table_data
        times = {name: round(content.pop(name), 3) for name in ("simulated_s", "wall_s")}
        error = content.pop("error")
        return {**content, **section, "error": error, **times}
