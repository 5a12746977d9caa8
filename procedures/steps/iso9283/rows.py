"""The rows of a test by ISO 9283. Joints and angles in degrees, lengths in mm; docs/reference/run-folder.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, final

from cellctl.devices import MeasuredPoint
from cellctl.records import Row, VerdictRow
from procedures.steps.tracker.rows import VisitedRow

Vector = tuple[float, ...]
When = Literal["before", "after"]


@final
@dataclass(frozen=True, kw_only=True)
class CubeRow(Row):
    """The ISO cube. centre, edge; points (5, 3): places of the first reflector, nominal robot's base frame, mm.

    readings (5, n): nominal joints of P1 … P5, deg. sides (5, 3, n): where their approaches along the base's x, y, z
    begin, deg.
    """

    KIND: ClassVar[str] = "iso cube"
    centre: Vector
    edge: float
    points: tuple[Vector, ...]
    readings: tuple[Vector, ...]
    sides: tuple[tuple[Vector, ...], ...]


@final
@dataclass(frozen=True, kw_only=True)
class IsoPoseRow(VisitedRow):
    """A visit to P1 … P5 (`place`, from 0) in a cycle, from 0. when: `before` by nominal joints, `after` by the table.

    side: 0 in the cycle of P1 … P5; 1, 2, 3: for vAP, along the base's x, y, z. others: further reflectors.
    """

    KIND: ClassVar[str] = "iso pose"
    MEASUREMENT: ClassVar[bool] = True
    when: When
    cycle: int
    place: int
    side: int
    others: tuple[MeasuredPoint, ...]


@final
@dataclass(frozen=True, kw_only=True)
class PointFigures:
    """Of one of P1 … P5: AP_p, its axes, AP_a … AP_c; RP_l, RP_a … RP_c (±); angles None without three reflectors.

    instrument_rp: RP_l that the instrument's noise alone gives, mm.
    """

    accuracy: float
    of_axes: Vector
    of_angles: Vector | None
    repeatability: float
    angle_repeatability: Vector | None
    instrument_rp: float


@final
@dataclass(frozen=True, kw_only=True)
class VariationFigures:
    """vAP of one of P1, P2, P4: position, mm; angles, deg, None without three reflectors."""

    position: float
    angles: Vector | None


@final
@dataclass(frozen=True, kw_only=True)
class IsoFigures:
    """The figures of a whole test. points: P1 … P5. distance_accuracy AD, distance_repeatability RD (±): P2 to P4.

    variation: vAP of P1, P2, P4, empty if not measured. complete: 30 cycles at least. left_out: cycles in which the
    station moved.
    """

    cycles: int
    complete: bool
    left_out: int
    points: tuple[PointFigures, ...]
    distance_accuracy: float
    distance_repeatability: float
    variation: tuple[VariationFigures, ...]


@final
@dataclass(frozen=True, kw_only=True)
class IsoRow(Row):
    """A whole test. deviations (n, 5, 3): attained less commanded place, mm, in the robot's base frame."""

    KIND: ClassVar[str] = "iso 9283"
    when: When
    figures: IsoFigures
    deviations: tuple[tuple[Vector, ...], ...]


@final
@dataclass(frozen=True, kw_only=True)
class RegistrationRow(Row):
    """Where instrument and reflectors are, from poses that are not judged.

    by: `nominal` robot, or `identified` one. poses: how many. residual: RMS, 3-D, mm. base (4, 4): the robot's base in
    the instrument's frame of the first session. reflectors (K, 3): in the flange frame, or the model's tool frame, mm.
    """

    KIND: ClassVar[str] = "iso registration"
    by: Literal["nominal", "identified"]
    poses: int
    residual: float
    base: tuple[Vector, ...]
    reflectors: tuple[Vector, ...]


@final
@dataclass(frozen=True, kw_only=True)
class IsoResult:
    """The test before and, with a model, after. edge, mm. speed_percent, arrival_percent: of axis speed, on transfers
    and on arrival. reflectors: measured at each pose.
    """

    before: IsoFigures
    after: IsoFigures | None
    edge: float
    speed_percent: float
    arrival_percent: float
    load: str
    payload_kg: float
    reflectors: int
    model_from: str | None


@final
@dataclass(frozen=True, kw_only=True)
class IsoVerdict(VerdictRow):
    """Verdict of a test by ISO 9283: `measured` without a model, else whether AP is better with its table.

    before, after: of AP over the five points.
    """

    SECTION: ClassVar[tuple[str, ...]] = ("iso9283", "accuracy", "noise_only")
    iso9283: IsoResult
    accuracy: str
    noise_only: bool
