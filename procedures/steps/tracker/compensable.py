"""Joints of a model for targets, and why a target gets no row in the table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self, final

import numpy as np

from cellctl.compensation import Compensated, compensate
from cellctl.formats import ModelFile
from cellctl.formats.table_making import nominal_chain, valid_region
from cellctl.kinematics import Bools, Floats

if TYPE_CHECKING:
    from cellctl.formats.table import TableRegion

SHARE_OF_LIMIT = 0.9
"""A target whose correction is nearer to the cell's limit is left out: the posture is near a singularity."""


@final
@dataclass(frozen=True, slots=True)
class Manner:
    """How targets are compensated: method, the most passes (None: until it converges), the cell's limit, deg."""

    method: str
    passes: int | None
    limit_deg: float


@final
@dataclass(frozen=True, eq=False)
class Compensable:
    """N targets (N, 4, 4), mm, in the model's frame, their nominal readings (N, n), deg, and the joints found.

    reasons: why each gets no row, empty where it gets one.
    """

    targets: Floats
    readings: Floats
    found: Compensated
    reasons: tuple[str, ...]

    @classmethod
    def of(cls, model: ModelFile, readings: Floats, manner: Manner) -> Self:
        """Of the targets where the registered nominal robot would be at `readings` (N, n), deg."""
        joints = model.robot.joint_map()
        q = joints.model(readings)
        targets = nominal_chain(model).forward(q)
        found = _compensated(model, targets, q, manner)
        commanded, region = joints.readings(found.compensated_q), valid_region(model)
        rows = zip(found.converged, readings, commanded, strict=True)
        reasons = (next(_reasons(*row, region, manner.limit_deg), "") for row in rows)
        return cls(targets, readings, found, tuple(reasons))

    @property
    def good(self) -> Bools:
        """Which targets (N,) get a row."""
        return np.array([not reason for reason in self.reasons], bool)


def _compensated(model: ModelFile, targets: Floats, q: Floats, manner: Manner) -> Compensated:
    """With a stated number of passes, as methods are published, a target is reached if the passes brought it nearer."""
    options = {} if manner.passes is None else {"passes": manner.passes}
    found = compensate(nominal_chain(model), model.robot_model(), targets, q, method=manner.method, **options)
    if manner.passes is None:
        return found
    return replace(found, converged=found.predicted_after_mm < found.predicted_before_mm)


def _reasons(
    reached: bool, before: Sequence[float], after: Sequence[float], region: TableRegion, limit_deg: float
) -> Iterator[str]:
    if not reached:
        yield "the method does not reach it"
    for axis, (low, high, angle) in enumerate(zip(region.min, region.max, after, strict=True), 1):
        if not low <= angle <= high:
            yield f"A{axis} at {angle:.1f}° is outside the measured region ({low:.1f}° to {high:.1f}°)"
    turned = np.abs(np.subtract(after, before))
    if turned.max() >= SHARE_OF_LIMIT * limit_deg:
        worst, share = int(turned.argmax()), f"{100 * SHARE_OF_LIMIT:.0f} % of"
        yield f"A{worst + 1} would be corrected by {turned[worst]:.2f}°, more than {share} the cell's {limit_deg:g}°"
