"""The rows that a campaign with spheres records. Joints in degrees, lengths in mm; docs/reference/run-folder.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, final

from cellctl.records import Figures, Row, VerdictRow
from procedures.steps.sphere.touch_plans import TouchSet

Joints = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ContactRow(Row):
    """A contact and the record of its search.

    resting: joints where the robot came to rest. time_ns, time_sigma_ns: the contact's time on the cell's clock and its
    1 σ. tick: the probe's count then. bounces: of the contact. stop_cycles: from the contact to the robot's first
    braked step. late, lost, skipped: telegrams of the search. attempt: at the step.
    """

    number: int
    sphere: str
    resting: Joints
    time_ns: int
    time_sigma_ns: int
    tick: int
    bounces: int
    stop_cycles: int
    late: int
    lost: int
    skipped: int
    attempt: int


@dataclass(frozen=True, kw_only=True)
class TouchRow(ContactRow):
    """A touch of the identification: `fit`, or `test` if held out. joints: at the contact."""

    KIND: ClassVar[str] = "touch"
    MEASUREMENT: ClassVar[bool] = True
    set: TouchSet
    joints: Joints


@final
@dataclass(frozen=True, kw_only=True)
class LocateRow(TouchRow):
    """A touch that locates the proof sphere; no fit uses it."""

    KIND: ClassVar[str] = "locate"
    MEASUREMENT: ClassVar[bool] = False


@final
@dataclass(frozen=True, kw_only=True)
class ReferenceRow(TouchRow):
    """A return to touch number `repeats`, after touch number `after_touch`; no fit uses it.

    shift_mm: shift of the contact along the sphere's normal since the first visit, by the nominal model;
    positive away from the sphere. sigma_mm: 1 σ of it without a change.
    """

    KIND: ClassVar[str] = "reference"
    MEASUREMENT: ClassVar[bool] = False
    repeats: int
    after_touch: int
    shift_mm: float
    sigma_mm: float


@final
@dataclass(frozen=True, kw_only=True)
class StandOffRow(ContactRow):
    """A stand-off: target `number`, with nominal joints before or with the table's `row` after.

    normal: unit vector from the sphere's centre. travel_mm: from the target to the contact. error_mm: travel less the
    intended distance; positive: the robot was too far. expected_mm, sigma_mm: the identified model's prediction of the
    error, and its 1 σ.
    """

    KIND: ClassVar[str] = "standoff"
    run: Literal["before", "after"]
    row: int | None
    nominal: Joints
    commanded: Joints
    at_target: Joints
    at_contact: Joints
    normal: tuple[float, ...]
    travel_mm: float
    error_mm: float
    expected_mm: float
    sigma_mm: float


@final
@dataclass(frozen=True)
class ProofRow(Row):
    """The proof sphere located by either model: centre, residuals of the touches that located it; the table's id."""

    KIND: ClassVar[str] = "proof"
    sphere: str
    nominal_centre: tuple[float, ...]
    identified_centre: tuple[float, ...]
    nominal_residuals: tuple[float, ...]
    identified_residuals: tuple[float, ...]
    table: str
    rows: int
    created: str
    max_correction_deg: float


@final
@dataclass(frozen=True)
class HeldOutFigures:
    """The verdict of the held-out touches on the model."""

    verdict: str
    before: Figures | None
    after: Figures | None


@final
@dataclass(frozen=True)
class StandOffFigures:
    """Stand-offs: errors before and after on `n` targets; rms of the predicted σ and of the unpredicted rest, mm."""

    before: Figures
    after: Figures
    n: int
    sphere: str
    predicted_sigma: float
    found_sigma: float


@final
@dataclass(frozen=True)
class DriftFigures:
    """The drift through the returns to the reference touch; total_mm: over all touches; modelled: corrected for."""

    visits: int
    mm_per_touch: float
    sigma_mm_per_touch: float
    t: float
    significant: bool
    total_mm: float
    modelled: bool


@final
@dataclass(frozen=True, kw_only=True)
class ConvergenceRow(Row):
    """|residual| of the touches at the nominal robot and after each iteration of the fit (K + 1,): mean and max, mm.

    nominal: with the sphere's centre as the start of the fit has it.
    """

    KIND: ClassVar[str] = "convergence"
    fit_mean: tuple[float, ...]
    fit_max: tuple[float, ...]
    held_out_mean: tuple[float, ...]
    held_out_max: tuple[float, ...]


@final
@dataclass(frozen=True)
class StopFigures:
    """The stops of the searches: travel from contact to rest by the nominal model; telegrams by outcome."""

    overtravel_mean_mm: float
    overtravel_max_mm: float
    stop_cycles_max: int
    late: int
    lost: int
    skipped: int

    def line(self) -> str:
        """One line for the operator."""
        return (
            f"Stops: over-travel {self.overtravel_mean_mm:.3f} mm mean ({self.overtravel_max_mm:.3f} max), within "
            f"{self.stop_cycles_max} cycles; telegrams late {self.late}, lost {self.lost}, skipped {self.skipped}."
        )


@dataclass(frozen=True, kw_only=True)
class SphereVerdict(VerdictRow):
    """The verdict on held-out touches; with `standoff`, that of the whole campaign. noise_scale: of the fit."""

    SECTION: ClassVar[tuple[str, ...]] = ("held_out", "standoff", "drift", "stops")
    drift: DriftFigures
    stops: StopFigures
    noise_scale: float = 1.0
    held_out: HeldOutFigures | None = None
    standoff: StandOffFigures | None = None
