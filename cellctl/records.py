"""Rows of the journal as classes: what steps record, and what every reader reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol, Self, TypeVar, final

from pydantic import TypeAdapter, ValidationError

from cellctl.files import canonical_json

__all__ = [
    "ENDED",
    "AnyRow",
    "ArtefactRow",
    "BadRow",
    "BatchRow",
    "ComputingTimesRow",
    "Figures",
    "IdentificationRow",
    "Json",
    "ResidualsRow",
    "Row",
    "Rows",
    "TablePushRow",
    "TableStateRow",
    "VerdictRow",
]


Json = Any
"""A JSON value; NaN and infinities are not allowed."""


@dataclass(frozen=True)
class Row:
    """A row of the journal. Derive a frozen dataclass from it; its fields are JSON, other such dataclasses, or tuples.

    KIND: its name in the journal. VERSION: counts changes that an older reader would misread. MEASUREMENT: it is a
    measured point of the run, and the result counts it under `points`. A field that is added later needs a default.
    """

    KIND: ClassVar[str]
    VERSION: ClassVar[int] = 1
    MEASUREMENT: ClassVar[bool] = False

    def data(self) -> dict[str, Json]:
        """The fields by name, as the journal keeps them."""
        return asdict(self)

    @classmethod
    def read(cls, data: Mapping[str, Json], version: int = 1) -> Self:
        """The row from `data` of `version`; unknown fields are ignored.

        Raises BadRow if a field is missing or has another type, or if the row has a newer version.
        """
        if version > cls.VERSION:
            raise BadRow(f"is of version {version}, and this program reads versions up to {cls.VERSION}")
        try:
            text = canonical_json(dict(cls.of_older(data, version)))
            row: Self = _reader(cls).validate_json(text, strict=True)
        except ValidationError as error:
            raise BadRow("; ".join(_words(detail) for detail in error.errors(include_url=False))) from None
        return row

    @classmethod
    def of_older(cls, data: Mapping[str, Json], version: int) -> Mapping[str, Json]:
        """`data` of an older `version` as this version has it. A class whose VERSION is above 1 overrides this."""
        return data


AnyRow = TypeVar("AnyRow", bound=Row)


@final
class BadRow(ValueError):
    """A row in the journal does not match its class; the text names the fields."""


class Rows(Protocol):
    """The rows of a run: a step's context and a `RunState` have them."""

    def recorded(self, kind: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of this class that count."""

    def all_recorded(self, *kinds: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of these classes of every attempt."""


_READERS: dict[type[Row], TypeAdapter[Any]] = {}


def _reader(kind: type[Row]) -> TypeAdapter[Any]:
    if kind not in _READERS:
        _READERS[kind] = TypeAdapter(kind)
    return _READERS[kind]


def _words(detail: Any) -> str:
    name = ".".join(str(part) for part in detail["loc"])
    if detail["type"] == "missing":
        return f"field '{name}' is missing"
    return f"field '{name}' holds {str(detail['input'])[:40]!r}, which is of another type"


@final
@dataclass(frozen=True)
class ArtefactRow(Row):
    """A file in the run folder (data set, model, table): its name, SHA-256 (hex) and size in bytes."""

    KIND: ClassVar[str] = "artefact"
    name: str
    sha256: str
    size: int


@final
@dataclass(frozen=True, kw_only=True)
class ComputingTimesRow(Row):
    """How long each of several computations of a step took on this computer, s: the least of `repeats`.

    A replay makes it again and does not compare it.
    """

    KIND: ClassVar[str] = "computing times"
    what: tuple[str, ...]
    seconds: tuple[float, ...]
    repeats: int


@dataclass(frozen=True)
class TableStateRow(Row):
    """State of a table: its id, number of rows, largest correction of a joint (deg).

    active: whether it is in force; None if a push or a rollback was begun and its end is unknown.
    """

    KIND: ClassVar[str] = "table"
    id: str
    rows: int
    pushed: bool
    verified: bool
    active: bool | None
    max_correction_deg: float

    @property
    def short(self) -> str:
        """The beginning of its id, as messages name it."""
        return self.id[:12]


@final
@dataclass(frozen=True)
class TablePushRow(TableStateRow):
    """A push begins. Until a `TableStateRow` follows, this table or the previous one may be active."""

    KIND: ClassVar[str] = "push"


@final
@dataclass(frozen=True)
class Figures:
    """Mean, root mean square and maximum of a set of errors, mm; None without errors."""

    mean: float | None
    rms: float | None
    max: float | None


ENDED = {
    "goal": "the goal is met",
    "rows": "the most that are allowed are used",
    "time": "the time is used",
    "gain": "the next batch would gain too little",
}
"""In words: what ended a campaign in batches, by `BatchRow.ended`."""


@final
@dataclass(frozen=True, kw_only=True)
class BatchRow(Row):
    """What is known after a batch of measurements, which `noun` names. rows: of the fit so far; of `most`.

    low_mm, median_mm, high_mm: 5 %, 50 % and 95 % quantile of the predicted volumetric error (3-D RMS) over the joint
    ranges of the held-out rows, for the `goal_mm`. next_mm: the 95 % quantile after the next batch, to_goal: number of
    rows until the goal; None where no batch was planned, or the rows that are left do not get there. seconds: of the
    measurements so far, on the cell's clock, without pauses. doubt: why the prediction cannot be trusted, in words.
    ended: what ended the campaign (`cellctl.planning.stopping.End`), empty where the next batch followed.
    """

    KIND: ClassVar[str] = "batch"
    noun: str
    rows: int
    most: int
    goal_mm: float
    low_mm: float
    median_mm: float
    high_mm: float
    next_mm: float | None
    to_goal: int | None
    seconds: float
    model: str
    doubt: str = ""
    ended: str = ""

    @property
    def sentence(self) -> str:
        """For the operator: the prediction, and what follows from it."""
        known = (
            f"{self.rows} {self.noun}: volumetric error {self.median_mm:.3f} mm in the median, below "
            f"{self.high_mm:.3f} mm with 95 % (goal {self.goal_mm:g})"
        )
        doubt = f"; not to be trusted yet: {self.doubt}" if self.doubt else ""
        return f"{known}{doubt}; {ENDED[self.ended] if self.ended else self._to_go()}"

    def _to_go(self) -> str:
        if self.to_goal is not None:
            return f"about {self.to_goal} more for the goal"
        after = f", {self.next_mm:.3f} mm after the next batch" if self.next_mm else ""
        return f"by what is known now the {self.most - self.rows} that may follow are too few for the goal{after}"


PASSED = frozenset({"better", "agree", "in control", "baseline", "measured"})
"""Verdicts with which a run ends well. The last three are of a check of a robot, which compares with no model."""


@dataclass(frozen=True)
class VerdictRow(Row):
    """The result of a campaign. Each kind of campaign derives its own row with the fields of its result's section.

    SECTION: the names of these fields, in the order in which the result shows them. verdict: `better`, `no better` or
    `worse`, or a check's own word; `not met`: better, and the goal that was asked for is not met. sentence: for the
    operator; lines: shown below it. before, after: measured errors. model: the report of the fit, as `cellctl fit
    --json` prints it.
    """

    KIND: ClassVar[str] = "verdict"
    SECTION: ClassVar[tuple[str, ...]] = ()
    verdict: str
    sentence: str
    before: Figures | None = None
    after: Figures | None = None
    model: Mapping[str, Json] | None = None
    table: TableStateRow | None = None
    lines: tuple[str, ...] = ()

    @property
    def better(self) -> bool:
        """Whether the robot is better than nominal, with or without its goal."""
        return self.verdict in ("better", "not met")

    @property
    def passed(self) -> bool:
        """Whether the run ends with exit code 0."""
        return self.verdict in PASSED


Number = float | None
"""A number; None where there is none."""

Vectors = tuple[tuple[Number, ...], ...]
"""An array of N rows."""


@final
@dataclass(frozen=True, kw_only=True)
class ResidualsRow(Row):
    """N measurement rows: residuals of the registered nominal robot and of the identified one, in row order.

    line (N,): of the data set. number (N,): of the touch, "" where it has none. row (N,): of the identification, from
    0. session (N,): number. point (N,): sphere or socket, "" where there is none; on_sphere (N,): whether a sphere was
    touched. held_out (N,): the fit did not use it. outlier (N,): left out of the fit, or held out and far from its
    prediction. readings (N, n): of the controller, deg.

    tip (N, 3): TCP by the identified robot, mm, in the measuring frame; tip_base (N, 3): in the robot's base frame.
    before, after (N, 3): model less measurement by the nominal and by the identified robot, mm, measuring frame; of a
    distance, along the line to the TCP. signed_before, signed_after (N,), normal (N, 3): such a distance, mm, positive
    outside a sphere, and that line; None for other rows. turn (N, 3): after, of the orientation, rad; None if it was
    not measured. joint_before, joint_after (N, n): the part along the way on which each joint moves the TCP, mm.
    scaled (N, 6): each number after, in its predicted σ; None if a row has fewer, or without a prediction.
    p_value (N,): of a held-out row; None for others.
    """

    KIND: ClassVar[str] = "residuals"
    line: tuple[int, ...]
    number: tuple[str, ...]
    row: tuple[int, ...]
    session: tuple[int, ...]
    point: tuple[str, ...]
    on_sphere: tuple[bool, ...]
    held_out: tuple[bool, ...]
    outlier: tuple[bool, ...]
    readings: Vectors
    tip: Vectors
    tip_base: Vectors
    before: Vectors
    after: Vectors
    signed_before: tuple[Number, ...]
    signed_after: tuple[Number, ...]
    normal: Vectors
    turn: Vectors
    joint_before: Vectors
    joint_after: Vectors
    scaled: Vectors
    p_value: tuple[Number, ...]


@final
@dataclass(frozen=True, kw_only=True)
class IdentificationRow(Row):
    """The report data of an identification besides its residuals. Texts are as the report shows them.

    head: verdict, figures and set-up. joints, sessions: names. one_frame: whether all sessions measured in one frame;
    base_turns (S, 3, 3): rotation of the robot's base in each session's frame. before, after (M,): errors that the
    distribution shows, mm, of held-out rows where `held_out`, else of the fit's rows. parameters: table, placements and
    points. correlation (F, F): of the parameters `correlated` (F,). unobservable: reasons, with combinations.
    sigma_rms_mm, sigma_max_mm: 1 σ of the TCP, 3-D, over the joints of the fit, `frame` in the measuring frame, `among`
    of points among themselves. along_joint: for each joint its readings, deg, and σ there (`among`), mm.
    hints, advice: what to measure next. left_out: rows that were not used, with reasons. distribution_free: the bound
    of a new row's error, in words; empty in runs that have none.
    """

    KIND: ClassVar[str] = "identification"
    head: Mapping[str, Json]
    joints: tuple[str, ...]
    sessions: tuple[str, ...]
    one_frame: bool
    base_turns: tuple[Vectors, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    held_out: bool
    parameters: Mapping[str, Json]
    correlated: tuple[str, ...]
    correlation: Vectors
    unobservable: tuple[Mapping[str, Json], ...]
    sigma_rms_mm: Mapping[str, float]
    sigma_max_mm: Mapping[str, float]
    along_joint: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]
    hints: tuple[str, ...]
    advice: Mapping[str, Json] | None
    left_out: tuple[Mapping[str, Json], ...]
    distribution_free: str = ""
