"""The rows that a campaign with a tracker records. Joints in degrees, lengths in mm; docs/reference/run-folder.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import ClassVar, Literal, Self, final

from cellctl.calibration import ComparedModel
from cellctl.devices import (
    CorrectionReport,
    CorrectionSample,
    MeasuredPoint,
    MotorCurrents,
    Temperatures,
    TwoFaceError,
    Weather,
)
from cellctl.records import Figures, Row, VerdictRow

Joints = tuple[float, ...]
Matrix = tuple[tuple[float, ...], ...]
PoseSet = Literal["fit", "test"]
When = Literal["start", "during", "end"]

ON_LINE = "on-line"
"""The method of a verdict on targets that were corrected on-line."""

CORRECTION_FILE = "correction.json"
"""The arrays that corrected on-line, in the run folder."""

MODEL_FILE = "read_model.json"
"""The model that was read, in the run folder; `model.json` is a run's own."""


@final
@dataclass(frozen=True, kw_only=True)
class ReadModelRow(Row):
    """The model of an earlier run: the run, the controller on which it was identified, and the model file's text."""

    KIND: ClassVar[str] = "read model"
    run: str
    serial: str
    text: str


@final
@dataclass(frozen=True, kw_only=True)
class SetUpRow(Row):
    """The instrument and the load at the start of a run, and after each resumption.

    load: the cell file's `load:`; payload_kg, payload_xyz: its mass, and its centre of gravity in the flange frame, mm.
    reflector_mm: what the instrument adds to every distance.
    """

    KIND: ClassVar[str] = "tracker setup"
    levelled: bool
    weather: Weather | None
    temperatures: Temperatures | None
    load: str
    payload_kg: float
    payload_xyz: tuple[float, ...]
    reflector_mm: float


@final
@dataclass(frozen=True, kw_only=True)
class StationRow(Row):
    """The instrument's frame in the robot's base frame from now on: matrix (4, 4), mm.

    session: name of the data set's session that begins or goes on. source: how it was found.
    """

    KIND: ClassVar[str] = "station"
    session: str
    source: Literal["cell file", "nests", "axes turned", "poses", "moved"]
    matrix: Matrix


@final
@dataclass(frozen=True, kw_only=True)
class NestRow(Row):
    """A monument nest, measured at visit number `visit` (from 0)."""

    KIND: ClassVar[str] = "nest"
    visit: int
    nest: str
    point: MeasuredPoint
    attempt: int


@final
@dataclass(frozen=True, kw_only=True)
class MonumentsRow(Row):
    """A visit to all nests: whether the station is still, has moved since the visit before, or is moving.

    session: in which what follows is. shift_mm: largest displacement of a nest since the session's first visit.
    p_still: probability of the measurements if the station is at rest.
    """

    KIND: ClassVar[str] = "monuments"
    visit: int
    when: When
    session: str
    verdict: Literal["still", "moved", "moving"]
    shift_mm: float
    p_still: float


@final
@dataclass(frozen=True, kw_only=True)
class ConstantRow(Row):
    """The reflector constant by certified distances between nests: how much too large it is, with 1 σ, mm.

    zero_sigma_mm: 1 σ of the zero of the instrument's range, which looks the same, mm.
    """

    KIND: ClassVar[str] = "reflector constant"
    error_mm: float
    sigma_mm: float
    zero_sigma_mm: float
    p_value: float
    sensitivity: float
    wrong: bool


@final
@dataclass(frozen=True, kw_only=True)
class TwoFaceRow(Row):
    """The difference between the instrument's faces at a nest, with its limit across the beam, mm."""

    KIND: ClassVar[str] = "two face"
    when: When
    nest: str
    error: TwoFaceError
    limit_mm: float


@dataclass(frozen=True, kw_only=True)
class VisitedRow(Row):
    """A reflector on the robot, measured at rest.

    number: of the pose in its plan. joints: actual on arrival; commanded; direction (n,): side from which each joint
    came, 1 or -1 of the reading, 0 if it did not move. visit: of the monuments before it. arm_c: temperature of the
    arm, None if not known. currents: taken on arrival, None without a source.
    """

    number: int
    reflector: str
    joints: Joints
    commanded: Joints
    direction: tuple[int, ...]
    visit: int
    arm_c: float | None
    currents: MotorCurrents | None
    point: MeasuredPoint
    attempt: int


@dataclass(frozen=True, kw_only=True)
class PoseRow(VisitedRow):
    """A pose of the identification, by nominal joints: `fit`, or `test` if held out.

    others: further reflectors of the plate, measured after the first one for a pose in six dimensions.
    """

    KIND: ClassVar[str] = "pose"
    MEASUREMENT: ClassVar[bool] = True
    set: PoseSet
    others: tuple[MeasuredPoint, ...] = ()


@final
@dataclass(frozen=True, kw_only=True)
class CompensatedRow(VisitedRow):
    """A held-out target, reached by row `row` of the active table.

    target: its place in the instrument's frame of the first session, mm.
    """

    KIND: ClassVar[str] = "compensated"
    row: int
    target: tuple[float, ...]


@final
@dataclass(frozen=True, kw_only=True)
class CorrectionModelRow(Row):
    """An on-line correction was switched on: id of its arrays, temperature of the arm, parts of the model left out."""

    KIND: ClassVar[str] = "correction model"
    id: str
    arm_c: float | None
    left_out: tuple[str, ...]


@final
@dataclass(frozen=True, kw_only=True)
class CorrectionLogRow(Row):
    """Samples of an on-line correction, one a second: time (ns), programmed joints, correction (deg), share of it."""

    KIND: ClassVar[str] = "correction log"
    time_ns: tuple[int, ...]
    programmed: tuple[Joints, ...]
    correction: tuple[Joints, ...]
    inside: tuple[float, ...]

    @classmethod
    def of(cls, samples: Sequence[CorrectionSample]) -> Self:
        """From a robot's samples."""
        return cls(
            time_ns=tuple(each.time_ns for each in samples),
            programmed=tuple(each.programmed for each in samples),
            correction=tuple(each.correction for each in samples),
            inside=tuple(each.inside for each in samples),
        )


@final
@dataclass(frozen=True, kw_only=True)
class CorrectionEndRow(Row):
    """An on-line correction was switched off: fields as in `CorrectionReport`."""

    KIND: ClassVar[str] = "correction end"
    cycles: int
    limited: int
    outside: int
    late: int
    lost: int
    refused_models: int

    @classmethod
    def of(cls, report: CorrectionReport) -> Self:
        """From a robot's report."""
        return cls(**asdict(report))

    @property
    def sentence(self) -> str:
        """In words."""
        return (
            f"on-line correction off after {self.cycles} cycles: {self.limited} cut by a limit, {self.outside} outside "
            f"the measured region, {self.late} answers late, {self.lost} telegrams lost"
        )


@final
@dataclass(frozen=True, kw_only=True)
class ReturnRow(VisitedRow):
    """The return pose: measured in the warm-up until it settles, and after each visit to the monuments."""

    KIND: ClassVar[str] = "return"


@final
@dataclass(frozen=True, kw_only=True)
class TurnRow(VisitedRow):
    """A point of the circle that the reflector makes about `axis` (from 1) alone."""

    KIND: ClassVar[str] = "turn"
    axis: int


@final
@dataclass(frozen=True, kw_only=True)
class FrameFigures:
    """A frame in the instrument's frame: matrix (4, 4), mm; sigma: three mm, three degrees, 1 σ each."""

    matrix: Matrix
    sigma: tuple[float, ...]


@final
@dataclass(frozen=True, kw_only=True)
class FramesRow(Row):
    """The frames {B} and {T} by turning A1, A2, A5, A6, and what they tell of instrument, reflector and gravity.

    station: the instrument in the robot's base frame. reflector: its centre in the flange frame, mm, with 1 σ; rough:
    by the cell file. gravity_deg: between the instrument's vertical and the robot file's, with 1 σ; None if the
    instrument is not levelled. radius, radius_sigma, residual (4,): of the circles of A1, A2, A5, A6, mm (RMS).
    outliers: points of the circles that were left out.
    """

    KIND: ClassVar[str] = "frames"
    base: FrameFigures
    tool: FrameFigures
    station: FrameFigures
    reflector: tuple[float, ...]
    reflector_sigma: tuple[float, ...]
    rough: tuple[float, ...]
    gravity_deg: float | None
    gravity_sigma_deg: float | None
    radius: tuple[float, ...]
    radius_sigma: tuple[float, ...]
    residual: tuple[float, ...]
    outliers: int


@final
@dataclass(frozen=True, kw_only=True)
class WarmUpRow(Row):
    """The end of the warm-up: returns measured; over the last of them the motion, its upper bound (95 %) and the
    scatter about it, with their limit, mm.
    """

    KIND: ClassVar[str] = "warm-up"
    returns: int
    settled: bool
    drift_mm: float
    drift_bound_mm: float
    scatter_mm: float
    limit_mm: float
    minutes: float


@final
@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """A target that is not measured or compensated: its name, and why."""

    target: str
    reason: str

    def __str__(self) -> str:
        return f"{self.target}: {self.reason}"


@final
@dataclass(frozen=True, kw_only=True)
class TargetPlanRow(Row):
    """The targets that will be measured: how many, and those left out before anything moved."""

    KIND: ClassVar[str] = "target plan"
    targets: int
    left_out: tuple[LeftOut, ...]


@final
@dataclass(frozen=True, kw_only=True)
class TargetsRow(Row):
    """The table of the held-out targets: its id, rows, largest correction (deg), date, and the method of compensation.

    left_out: numbers of held-out poses without a row; reasons: of each of them. passes: the most that the method made.
    """

    KIND: ClassVar[str] = "targets"
    table: str
    rows: int
    created: str
    max_correction_deg: float
    left_out: tuple[int, ...]
    reasons: tuple[str, ...] = ()
    method: str = "pseudo-target"
    passes: int | None = None

    @property
    def manner(self) -> str:
        """Method and passes, in words."""
        passes = "passes until it converges" if self.passes is None else f"passes: {self.passes} at most"
        return f"{self.method} ({passes})"


@final
@dataclass(frozen=True, kw_only=True)
class TargetErrorsRow(Row):
    """N held-out targets measured twice. number (N,): of the pose. late (N,): in the late block.

    before, after (N, 3): measured less intended place, mm, instrument's frame. sigma (N,): predicted 1 σ (3-D) of
    `after`, mm; empty with a model that states none. place (N, 3): in the robot's base frame, mm.
    """

    KIND: ClassVar[str] = "target errors"
    number: tuple[int, ...]
    late: tuple[bool, ...]
    before: Matrix
    after: Matrix
    sigma: tuple[float, ...]
    place: Matrix


@final
@dataclass(frozen=True, kw_only=True)
class HeldOutFigures:
    """The verdict of the held-out poses on the model; predicted, found: RMS of the error, mm."""

    verdict: str
    before: Figures | None
    after: Figures | None
    predicted: float | None


@final
@dataclass(frozen=True, kw_only=True)
class TargetFigures:
    """Held-out targets measured before, by nominal joints, and after, by the table: errors of `n`, mm.

    predicted_sigma, found_sigma: RMS (3-D) of the predicted σ (None: the model states none) and of the errors after.
    mean_95, rms_95: 95 % intervals of mean and RMS, before and after, mm. share_below: with 95 % confidence at least
    this share of such targets has an error below the greatest found.
    """

    before: Figures
    after: Figures
    n: int
    interleaved_after: float
    late_after: float
    predicted_sigma: float | None
    found_sigma: float
    mean_95: tuple[tuple[float, float], ...] | None = None
    rms_95: tuple[tuple[float, float], ...] | None = None
    share_below: float | None = None


@final
@dataclass(frozen=True, kw_only=True)
class SixFigures:
    """Errors of `n` poses: mean of |Δx|, |Δy|, |Δz|, mm, and of the angle, deg; before: registered nominal robot."""

    n: int
    before: tuple[float, ...]
    after: tuple[float, ...]
    angle_before: float
    angle_after: float


@final
@dataclass(frozen=True, kw_only=True)
class SixRow(Row):
    """Poses in six dimensions: errors of the fit and of the held-out ones; |R_ii| of the QR of the fit.

    parameters (F,), r (F,): each free parameter in the order of the pivots, and |R_ii|: by how many standard deviations
    one prior σ of it changes the rows, beyond what those before it can. observable: below this, a parameter is
    redundant.
    """

    KIND: ClassVar[str] = "six dimensions"
    fit: SixFigures
    test: SixFigures
    parameters: tuple[str, ...]
    r: tuple[float, ...]
    observable: float


@final
@dataclass(frozen=True, kw_only=True)
class ComparedModelsRow(Row):
    """Models identified from the same poses, the campaign's own first. errors: of each on the held-out poses (N,), mm;
    nominal (N,): the nominal robot's. left_out: models that could not be fitted, each with the reason.
    """

    KIND: ClassVar[str] = "compared models"
    models: tuple[ComparedModel, ...]
    errors: Matrix
    nominal: tuple[float, ...]
    left_out: tuple[str, ...]


@final
@dataclass(frozen=True, kw_only=True)
class ComparedMethod:
    """What a method of compensation leaves of N targets by the identified robot, computed.

    error_mm, error_deg (N,): distance and angle of the TCP from the target after one pass. passes: until each target
    converges. converged: number of targets that do.
    """

    method: str
    error_mm: tuple[float, ...]
    error_deg: tuple[float, ...]
    passes: int
    converged: int


@final
@dataclass(frozen=True, kw_only=True)
class ComparedMethodsRow(Row):
    """Methods of compensation on the N targets of the table, in its order. before_mm (N,): at the nominal joints."""

    KIND: ClassVar[str] = "compared methods"
    methods: tuple[ComparedMethod, ...]
    before_mm: tuple[float, ...]


@final
@dataclass(frozen=True, kw_only=True)
class TrackerVerdict(VerdictRow):
    """The verdict on held-out poses; with `targets`, that of the whole campaign.

    accuracy: profile of the instrument; noise_only: of its noise alone. noise_scale: of the fit. sessions: of the data
    set. ambiguous: poses that no session could be given to. load: the cell file's. model_from: run whose model was
    read, None if the run identified its own. method: of compensation. left_out: targets that were left out.
    """

    SECTION: ClassVar[tuple[str, ...]] = (
        "held_out",
        "targets",
        "accuracy",
        "noise_only",
        "noise_scale",
        "sessions",
        "ambiguous",
        "load",
        "model_from",
        "method",
        "left_out",
    )
    accuracy: str
    noise_only: bool
    noise_scale: float
    sessions: tuple[str, ...]
    ambiguous: int
    load: str
    held_out: HeldOutFigures | None = None
    targets: TargetFigures | None = None
    model_from: str | None = None
    method: str | None = None
    left_out: tuple[LeftOut, ...] = ()
