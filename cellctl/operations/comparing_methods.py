"""Compares the compensation methods on one model and its targets: accuracy, error of each pass, time."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, final

from cellctl.formats import ModelFile
from cellctl.formats.table_making import mean_rms_max
from cellctl.formats.targets import Targets
from cellctl.operations.compensating import Tried, refuse_model, try_targets

if TYPE_CHECKING:
    from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, slots=True)
class Accuracy:
    """Predicted distances (mm) and angles (deg) from the targets: mean, RMS, max."""

    position_mm: dict[str, float]
    orientation_deg: dict[str, float]


@final
@dataclass(frozen=True, slots=True)
class MethodFigures:
    """One method on all targets.

    targets, reached: their counts; unreached: line and reason of each of the others. before, one_pass, iterated: at the
    nominal joints, after one pass, and repeated to the tolerance, over the targets that are reached; None where none
    is. per_pass_mm: mean error before the first pass and after each. position_only: the orientation is not compensated.
    repeats: whether a further pass changes anything. seconds_per_target: to find the joints, with the inverse.
    """

    method: str
    targets: int
    reached: int
    unreached: list[tuple[int, str]]
    before: Accuracy | None
    one_pass: Accuracy | None
    iterated: Accuracy | None
    per_pass_mm: list[float]
    position_only: bool
    repeats: bool
    seconds_per_target: float

    def dump(self) -> dict[str, Any]:
        """As JSON."""
        unreached = [{"line": line, "reason": reason} for line, reason in self.unreached]
        return {**asdict(self), "unreached": unreached}


def compare_methods(model: ModelFile, wanted: Targets, file: str, correction_deg: float) -> list[MethodFigures]:
    """Every method on the targets `wanted`, of `file`; correction_deg: the largest correction of a joint.

    Raises InputError for a model that cannot predict a target without further data.
    """
    from cellctl.compensation import METHODS

    refuse_model(model, file)
    return [_figures(model, wanted, method, correction_deg) for method in METHODS]


def _figures(model: ModelFile, wanted: Targets, method: str, correction_deg: float) -> MethodFigures:
    import numpy as np

    from cellctl.compensation import METHODS

    once = try_targets(model, wanted, method=method, passes=1, correction_deg=correction_deg)
    tried = try_targets(model, wanted, method=method, correction_deg=correction_deg)
    good = np.array([not reasons for reasons in tried.reasons])
    rows, after_one = good & np.array([not reasons for reasons in once.reasons]), _last(once)
    per_pass = tried.found.error_mm[:, good]
    return MethodFigures(
        method=method,
        targets=len(good),
        reached=int(good.sum()),
        unreached=tried.refused(),
        before=_accuracy(tried.found.error_mm[0][good], tried.found.error_deg[0][good]),
        one_pass=_accuracy(*(each[rows] for each in after_one)),
        iterated=_accuracy(*(each[good] for each in _last(tried))),
        per_pass_mm=per_pass.mean(axis=1).tolist() if good.any() else [],
        position_only=tried.found.position_only,
        repeats=METHODS[method].write_back is None,
        seconds_per_target=tried.seconds / max(len(good), 1),
    )


def _last(tried: Tried) -> tuple[Floats, Floats]:
    """Distance and angle (N,) after the last pass."""
    return tried.found.error_mm[-1], tried.found.error_deg[-1]


def _accuracy(millimetres: Floats, degrees: Floats) -> Accuracy | None:
    return Accuracy(mean_rms_max(millimetres), mean_rms_max(degrees)) if len(millimetres) else None
