"""The typed events of a run, to rows and back. A kind may gain fields with defaults; none is renamed or removed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import cache
from typing import Any, ClassVar, final, get_args

from pydantic import TypeAdapter, ValidationError

from cellctl.files import canonical_json
from cellctl.files.validated import plain_words
from cellctl.records import Json, Row


@final
@dataclass(frozen=True, slots=True)
class SourceFile:
    """A file at the start of the run: its path, its text, SHA-256 (hex) of the text."""

    path: str
    text: str
    sha256: str


@final
@dataclass(frozen=True, slots=True)
class RunStarted:
    """The first event: everything that identifies what was run and shows later changes.

    `versions`: package → version, `python` among them. `clock`: `realtime` or `lockstep`. `calendar`: UTC, ISO 8601.
    `robot`: the robot file; the artefact is in the cell file. `sources`: Python files of cellctl, drivers and steps, by
    name, with the SHA-256 of each. `name`: of the run; its folder may be renamed later. `section`: the fields of a
    verdict that only this kind of campaign has; None in older journals.
    """

    kind: ClassVar[str] = "run_started"
    procedure: SourceFile
    cell: SourceFile
    parameters: Mapping[str, Json]
    seed: int
    clock: str
    operator: str
    calendar: str
    code_sha256: str
    versions: Mapping[str, str]
    robot: SourceFile | None = None
    sources: Mapping[str, str] = field(default_factory=dict)
    name: str = ""
    section: tuple[str, ...] | None = None


@final
@dataclass(frozen=True, slots=True)
class RunResumed:
    """A new process continues the run; the cell's time may restart. `acknowledged`: a person checked the cell."""

    kind: ClassVar[str] = "run_resumed"
    operator: str
    calendar: str
    code_sha256: str
    versions: Mapping[str, str]
    acknowledged: bool = False


@final
@dataclass(frozen=True, slots=True)
class DevicesConnected:
    """The identities that the devices reported: name in the cell → serial, model, firmware, simulated."""

    kind: ClassVar[str] = "devices_connected"
    identities: Mapping[str, Mapping[str, Json]]


@final
@dataclass(frozen=True, slots=True)
class DeviceHealth:
    """The health that a device reported once it was connected; again when the inputs of the cell change between steps.

    `latency_ms`: from a request to its answer in the cell's time, None if its driver does not report it. `mode`: a
    robot's operating mode, empty if not reported. `inputs`: of a CellIO, by name.
    """

    kind: ClassVar[str] = "device_health"
    device: str
    ok: bool
    text: str
    latency_ms: float | None = None
    mode: str = ""
    inputs: Mapping[str, bool] = field(default_factory=dict)


@final
@dataclass(frozen=True, slots=True)
class StateChanged:
    """The engine went from one state to another. `before` and `after` are state names (`running`, `paused`)."""

    kind: ClassVar[str] = "state_changed"
    before: str
    after: str
    reason: str = ""


@final
@dataclass(frozen=True, slots=True)
class StepStarted:
    """An attempt (from 1) at a step begins. `moves`: an interruption leaves the cell in an uncertain state."""

    kind: ClassVar[str] = "step_started"
    step: str
    attempt: int
    moves: bool
    do: str = ""


class Outcome(StrEnum):
    """How an attempt at a step ended. `interrupted`: the process died first; only `fold` sets it."""

    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"
    TIMED_OUT = "timed_out"
    INTERRUPTED = "interrupted"


@final
@dataclass(frozen=True, slots=True)
class StepFailure:
    """Why an attempt failed: the error's class name, its text, and the cure."""

    error: str
    text: str
    cure: str = ""

    @classmethod
    def of(cls, error: BaseException) -> StepFailure:
        """The failure that describes `error`."""
        return cls(type(error).__name__, str(error), getattr(error, "cure", ""))


@final
@dataclass(frozen=True, slots=True)
class StepEnded:
    """The attempt ended; `result` (JSON) if it is done, else `failure`."""

    kind: ClassVar[str] = "step_ended"
    step: str
    attempt: int
    outcome: Outcome
    result: Json = None
    failure: StepFailure | None = None


@final
@dataclass(frozen=True, slots=True)
class Recorded:
    """A row of the given `row_kind` (`touch`), by a step's attempt, or by the engine (empty, 0).

    `version`: of its class. `measurement`: it is a measured point of the run; None in older journals.
    """

    kind: ClassVar[str] = "recorded"
    row_kind: str
    data: Mapping[str, Json]
    step: str = ""
    attempt: int = 0
    version: int = 1
    measurement: bool | None = None

    @classmethod
    def of(cls, row: Row, step: str = "", attempt: int = 0) -> Recorded:
        """The event that records `row`."""
        return cls(row.KIND, row.data(), step, attempt, row.VERSION, row.MEASUREMENT)


@final
@dataclass(frozen=True, slots=True)
class Said:
    """A line of progress for the operator."""

    kind: ClassVar[str] = "said"
    text: str
    step: str = ""


@final
@dataclass(frozen=True, slots=True)
class OperatorAction:
    """An operator's action on the run: `pause`, `resume`, `abort`, `confirm`, `acknowledge`, `reset` (of a simulated
    cell).

    `operator` on `host`, through `via` (`cli`, `terminal`, `SIGINT`, `console`), at `calendar` (UTC, ISO 8601).
    `text`: the reason, or the step that is confirmed. `refused`: why it was refused; empty if it was done.
    `id`: of the file that brought it, if any.
    """

    kind: ClassVar[str] = "operator_action"
    action: str
    operator: str = ""
    text: str = ""
    host: str = ""
    via: str = ""
    calendar: str = ""
    refused: str = ""
    id: str = ""


@final
@dataclass(frozen=True, slots=True)
class InterlockChanged:
    """An interlock broke (`holds` false), or its condition holds again; `text`: the condition and the reason."""

    kind: ClassVar[str] = "interlock_changed"
    interlock: str
    device: str
    condition: str
    holds: bool
    text: str = ""


@final
@dataclass(frozen=True, slots=True)
class RunEnded:
    """The run ended in `state`; `verdict` is empty if there is none, `result` as `--json` prints it.

    `reason`: text of the error that ended it. `troubles`: what the clean-up did not achieve. `robot`: the state of the
    robot in words, `calendar`: when it ended, UTC, ISO 8601; both empty in older journals.
    """

    kind: ClassVar[str] = "run_ended"
    state: str
    verdict: str = ""
    reason: str = ""
    result: Mapping[str, Json] = field(default_factory=dict)
    troubles: tuple[str, ...] = ()
    robot: str = ""
    calendar: str = ""


@final
@dataclass(frozen=True, slots=True)
class RawEvent:
    """An event of a kind unknown to this version; kept, shown, and otherwise ignored."""

    kind: str
    data: Mapping[str, Json]
    step: str = ""
    attempt: int = 0


KnownEvent = (
    RunStarted
    | RunResumed
    | DevicesConnected
    | DeviceHealth
    | StateChanged
    | StepStarted
    | StepEnded
    | Recorded
    | Said
    | OperatorAction
    | InterlockChanged
    | RunEnded
)
Event = KnownEvent | RawEvent


@final
@dataclass(frozen=True, slots=True)
class Entry:
    """A committed event: its number in the journal (from 1, no gaps) and the cell's time in nanoseconds."""

    seq: int
    time_ns: int
    event: Event


Columns = tuple[str, str, int, str]
"""kind, step, attempt, data: the event's other fields as canonical JSON."""


def encode(event: KnownEvent) -> Columns:
    """The row of `event`. Raises ValueError, naming event and step, for NaN and other values that JSON cannot hold."""
    fields = asdict(event)
    step, attempt = fields.pop("step", ""), fields.pop("attempt", 0)
    try:
        data = canonical_json(fields)
        data.encode()
    except (ValueError, TypeError) as error:
        where = f" of step '{step}'" if step else ""
        raise ValueError(f"event '{event.kind}'{where} cannot be recorded: {error}") from error
    return event.kind, step, attempt, data


def decode(columns: Columns) -> Event:
    """The event in a row. An unknown kind gives a RawEvent; unknown fields are ignored.

    Raises ValueError if the row does not match its kind.
    """
    kind, step, attempt, text = columns
    try:
        data: dict[str, Any] = json.loads(text)
    except ValueError as error:
        raise ValueError(f"{kind}: its data is no JSON") from error
    reader = _readers().get(kind)
    if reader is None:
        return RawEvent(kind, data, step, attempt)
    try:
        event: Event = reader.validate_python({**data, "step": step, "attempt": attempt})
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        raise ValueError(f"{kind}: {'.'.join(map(str, detail['loc']))} {plain_words(detail)}") from error
    return event


@cache
def _readers() -> dict[str, TypeAdapter[Any]]:
    return {event.kind: TypeAdapter(event) for event in get_args(KnownEvent)}
