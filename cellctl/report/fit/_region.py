"""σ of the TCP over the joints, inside the measured joint region and outside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self, final

import numpy as np

from cellctl.calibration import MeasuredRegion, RobotModel, prediction_sigma
from cellctl.calibration.prediction.predict import REGION_POINTS
from cellctl.kinematics import Floats
from cellctl.kinematics.low_discrepancy import spread_over
from cellctl.report.fit._story import FitStory

_AWAY_DEG = 60.0
"""Distance beyond the region of the fit that is evaluated for a joint, within its limits; of a prismatic one 1 m."""

_STEPS, _SAMPLES = 25, 64


@final
@dataclass(frozen=True, eq=False)
class RegionSigma:
    """1 σ, 3-D, mm, of TCPs predicted by a model whose parameters have the covariance (P, P), as `ModelFile.sigma`.

    Points among themselves: the rigid motion of all points of the region lower … upper (n,), rad, that is nearest to
    each possible error of the model is subtracted, inside the region and outside it.
    """

    model: RobotModel
    covariance: Floats
    region: MeasuredRegion
    lower: Floats
    upper: Floats

    @classmethod
    def of(cls, story: FitStory) -> Self:
        """Of a fit, over the joints of its rows."""
        found, robot = story.found, story.found.unknowns.robot
        q = story.task.rows.pick(story.used).q
        covariance = found.covariance[:robot, :robot]
        return cls(found.state.model, covariance, story.result.region, q.min(axis=0), q.max(axis=0))

    @cached_property
    def postures(self) -> Floats:
        """Postures (N, n) spread over the region."""
        return spread_over(self.lower, self.upper, REGION_POINTS, scramble=False)

    def in_frame(self, q: Floats) -> Floats:
        """1 σ (N,) at q (N, n) in the measuring frame: base and heading count."""
        return prediction_sigma(self.model, self.covariance, q, self.region)

    def among(self, q: Floats) -> Floats:
        """1 σ (N,) at q (N, n) relative to the region."""
        return prediction_sigma(self.model, self.covariance, q, self.region, kind="among", over=self.postures)

    @cached_property
    def besides(self) -> float:
        """RMS over the region of what no further row of this kind lowers: scatter, open variance, outside; mm."""
        scatter = self.region.sigma(self.postures) ** 2 + 3.0 * self.model.open_variance(self.postures)
        return self.region.model_error_scale * float(np.sqrt(np.mean(scatter)))


def figures(region: RegionSigma) -> tuple[dict[str, float], dict[str, float]]:
    """RMS and maximum σ over the region, mm: in the measuring `frame`, and of points `among` themselves."""
    sigmas = {"frame": region.in_frame(region.postures), "among": region.among(region.postures)}
    rms = {name: float(np.sqrt(np.mean(sigma**2))) for name, sigma in sigmas.items()}
    return rms, {name: float(sigma.max()) for name, sigma in sigmas.items()}


def bound_in_words(story: FitStory) -> str:
    """95 % radius of a place over its σ; the distribution-free bound of a new row's error by bin, or why it is not
    known.
    """
    bound = story.result.distribution_free
    what = "distance along the normal" if bound.along_normal else "place"
    radius = f"95 % of places are within {story.result.region.radius_95:.2f} times their σ."
    begin = f"{radius} Bound of the {what} of a new row without an assumed distribution"
    if not bound.bins:
        return f"{begin}: not known ({bound.unknown})."
    sizes = [
        f"{'not known' if np.isnan(mm) else f'{mm:.3f} mm'} where σ of the row is up to {each.sigma_to:.3f} mm"
        for each, mm in zip(bound.bins, bound.typical_mm, strict=True)
    ]
    return f"{begin} (CV+, {100.0 * bound.guarantee:.0f} % at least): {', '.join(sizes)}."


def curves(story: FitStory, region: RegionSigma) -> list[tuple[Floats, Floats]]:
    """Of each joint: readings (S,), deg or mm, and σ of points among themselves there, mm, the other joints varied."""
    joints, found = story.robot.joint_map(), [along_joint(story, region, joint) for joint in range(region.model.n)]
    return [(joints.readings(np.tile(q[:, None], joints.n))[:, joint], sigma) for joint, (q, sigma) in enumerate(found)]


def along_joint(story: FitStory, region: RegionSigma, joint: int) -> tuple[Floats, Floats]:
    """Model coordinates (S,), rad or m, of `joint`, and σ there, RMS over the others, mm."""
    away, limits = np.deg2rad(_AWAY_DEG), story.limits[joint]
    first = min(region.lower[joint], max(limits[0], region.lower[joint] - away))
    last = max(region.upper[joint], min(limits[1], region.upper[joint] + away))
    at = np.linspace(first, last, _STEPS)
    q = np.tile(region.postures[:_SAMPLES], (_STEPS, 1, 1))
    q[:, :, joint] = at[:, None]
    sigma = region.among(q.reshape(-1, q.shape[-1])).reshape(_STEPS, -1)
    return at, np.sqrt(np.mean(sigma**2, axis=1))
