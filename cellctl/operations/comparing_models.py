"""The difference of two identified models of one nominal robot: each parameter, the TCP, and whether it is above σ.

Both fits start from the same prior, so their results are not independent (`difference_covariance`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from pydantic import computed_field

from cellctl.calibration import RobotModel
from cellctl.calibration.distributions import chi2_sf, normal_sf
from cellctl.calibration.prediction.predict import shape_columns
from cellctl.calibration.problem.registration import rigid_fit
from cellctl.calibration.verdict.agreement import difference_covariance
from cellctl.formats import ModelFile
from cellctl.formats.model import Parameter
from cellctl.kinematics import Bools, Floats

_COVERAGE = 2.0
"""Coverage factor k: a change above k σ is called significant; without a change 4.6 % are."""


def significant(change: float | None, sigma: float | None) -> bool | None:
    """Whether a change is above 2 σ; None where change or σ is not known."""
    return None if change is None or sigma is None else abs(change) > _COVERAGE * sigma


class ComparedNumber:
    """A number of a and of b, None where one has none, and 1 σ of their difference, None where it is not known."""

    __slots__ = ()
    a: float | None
    b: float | None
    sigma: float | None

    @computed_field
    @property
    def difference(self) -> float | None:
        """b less a."""
        return None if self.a is None or self.b is None else self.b - self.a

    @computed_field
    @property
    def significant(self) -> bool | None:
        """Whether the difference is above 2 σ; None without σ."""
        return significant(self.difference, self.sigma)


_LEVEL = 0.05
"""Models differ if the p-value is below it."""

_LEAST_SHOWN = 0.001
"""A smaller p-value is only said to be below it."""

_DETERMINED = 0.9
"""A parameter is determined by the rows if σ after them is below this part of σ before."""

_SINGULAR = 1e-9
"""Eigenvalue of a correlation matrix below which a combination of parameters has no variance."""

_POSTURES, _SEED = 300, 1


@final
@dataclass(frozen=True, slots=True)
class ParameterChange(ComparedNumber):
    """One parameter of models a and b, in `unit` as shown to people; None where a model does not have it free.

    sigma: 1 σ of the difference; None where the rows of one model do not determine it, or there is no difference.
    """

    name: str
    label: str
    unit: str
    a: float | None
    b: float | None
    sigma_a: float | None
    sigma_b: float | None
    sigma: float | None


@final
@dataclass(frozen=True, slots=True)
class ModelDifference:
    """The difference of two models: their parameters, largest difference in σ first, and the tests of the whole.

    chi2, dof: of all determined parameters together. p_value: probability of at least this difference if the robot has
    not changed, by χ² (many small changes) and by the largest difference (one change). tcp_rms_mm, tcp_max_mm: distance
    of the two models' TCPs over the joints that both measured, with base and tool of one registered to the other;
    tcp_sigma_mm: RMS that σ alone explains; None without common joints. left_out: parameters that are not compared,
    with the reason.
    """

    parameters: tuple[ParameterChange, ...]
    chi2: float
    dof: int
    p_value: float
    tcp_rms_mm: float | None
    tcp_max_mm: float | None
    tcp_sigma_mm: float | None
    left_out: tuple[str, ...]

    @property
    def differ(self) -> bool:
        """Whether σ does not explain the difference, at a level of 5 %."""
        return self.p_value < _LEVEL

    @computed_field
    @property
    def sentence(self) -> str:
        """The result in a sentence."""
        known = [each for each in self.parameters if each.sigma is not None]
        if not known:
            return "No parameter is determined by the rows of both models."
        count = sum(bool(each.significant) for each in known)
        counted = f"{count} of {len(known)} determined parameters differ by more than 2 σ"
        p_value = f"p = {self.p_value:.2g}" if self.p_value >= _LEAST_SHOWN else f"p < {_LEAST_SHOWN:g}"
        whole = "The models differ" if self.differ else "σ explains the difference of the models"
        return f"{whole} ({p_value}): {counted}."


def incomparable(a: ModelFile, b: ModelFile) -> str:
    """Why the parameters of two models cannot be compared; empty if they can."""
    if a.robot.convention != b.robot.convention or a.robot.links != b.robot.links or a.robot.joints != b.robot.joints:
        return f"the models start from different nominal robots ('{a.robot.name}' and '{b.robot.name}')"
    return ""


def model_difference(a: ModelFile, b: ModelFile) -> ModelDifference:
    """Compare two models of the same nominal robot. Raises ValueError with the reason if they are `incomparable`."""
    if why := incomparable(a, b):
        raise ValueError(why)
    return _Comparison(a, b).difference()


def free_names(model: ModelFile) -> list[str]:
    """Names of the parameters that the fit changed."""
    return [parameter.name for parameter in model.parameters if parameter.prior_sigma > 0.0]


def determined(parameter: Parameter) -> bool:
    """Whether the rows determine a parameter, by its σ after and before them."""
    return 0.0 < parameter.sigma < _DETERMINED * parameter.prior_sigma


@final
@dataclass(frozen=True, eq=False)
class _Side:
    """One model's parameters in the order of both models' `names`; 0 where it does not have one.

    values (P,); covariance (P, P); prior (P,): variances before the rows, 0 for a held parameter.
    """

    values: Floats
    covariance: Floats
    prior: Floats

    @classmethod
    def of(cls, file: ModelFile, names: Sequence[str]) -> _Side:
        own = {parameter.name: place for place, parameter in enumerate(file.parameters)}
        here = [place for place, name in enumerate(names) if name in own]
        there = [own[names[place]] for place in here]
        values, prior, covariance = np.zeros(len(names)), np.zeros(len(names)), np.zeros((len(names), len(names)))
        values[here] = [file.parameters[place].value for place in there]
        prior[here] = [file.parameters[place].prior_sigma ** 2 for place in there]
        covariance[np.ix_(here, here)] = np.array(file.covariance)[np.ix_(there, there)]
        return cls(values, covariance, prior)

    @property
    def determined(self) -> Bools:
        """Which parameters (P,) its rows determine."""
        return np.asarray((self.prior > 0.0) & (np.diag(self.covariance) < _DETERMINED**2 * self.prior))

    def stated(self, place: int, factor: float) -> tuple[float, float] | tuple[None, None]:
        """Value and σ of a parameter in units of `factor`; None if it is held."""
        if self.prior[place] <= 0.0:
            return None, None
        return float(self.values[place]) * factor, float(np.sqrt(self.covariance[place, place])) * factor


class _Comparison:
    """Two models with all free parameters of either in one order."""

    def __init__(self, a: ModelFile, b: ModelFile) -> None:
        self._files, self._models = (a, b), (a.robot_model(), b.robot_model())
        free = set(free_names(a)) | set(free_names(b))
        self._known = {each.name: each for model in self._models for each in model.parameters if each.name in free}
        self._moved = [name for name, pose in a.start.items() if pose != b.start[name]]
        self._a, self._b = (_Side.of(file, list(self._known)) for file in self._files)

    def difference(self) -> ModelDifference:
        a, b = self._a, self._b
        variance = difference_covariance(a.covariance, a.prior, b.covariance, b.prior)
        compared = np.array([each.group not in self._moved for each in self._known.values()], bool)
        known = compared & a.determined & b.determined
        changes = [
            self._change(place, variance, known=bool(known[place])) for place in np.flatnonzero(compared).tolist()
        ]
        changes.sort(key=lambda each: -_in_sigmas(each))
        chi2, dof, p_value = _test((b.values - a.values)[known], variance[np.ix_(known, known)])
        left_out = tuple(f"{frame}: its pose before the fit is another" for frame in self._moved)
        rms, largest, sigma = self._tcp(variance)
        return ModelDifference(tuple(changes), chi2, dof, p_value, rms, largest, sigma, left_out)

    def _change(self, place: int, variance: Floats, *, known: bool) -> ParameterChange:
        parameter = list(self._known.values())[place]
        factor = parameter.unit.factor
        (a, sigma_a), (b, sigma_b) = (side.stated(place, factor) for side in (self._a, self._b))
        sigma = float(np.sqrt(max(variance[place, place], 0.0))) * factor if known else None
        return ParameterChange(parameter.name, parameter.label, parameter.unit.shown, a, b, sigma_a, sigma_b, sigma)

    def _tcp(self, variance: Floats) -> tuple[float | None, float | None, float | None]:
        """RMS and largest distance of the TCPs, and the RMS that σ explains, mm."""
        readings = self._readings()
        if readings is None:
            return None, None, None
        at = self._files[0].robot.joint_map().model(readings)
        tool, sigma = self._tool_and_sigma(variance, at)
        points, others = (_with_tool(model, self._models[0].chain.tool_now, at) for model in self._models)
        far = np.linalg.norm(_without(tool, _moved_onto(others, points) - points), axis=1)
        return float(np.sqrt(np.mean(far**2))), float(far.max()), sigma

    def _tool_and_sigma(self, variance: Floats, at: Floats) -> tuple[Floats, float]:
        """Basis (3N, 3) of a tool's translation, and the RMS over the postures of what σ explains, mm."""
        of_a, of_b = (dict(zip(model.names, shape_columns(model, at).T, strict=True)) for model in self._models)
        tool, _ = np.linalg.qr(np.stack([of_a[f"tool_{axis}"] for axis in "xyz"], axis=1))
        columns = np.stack([(of_b | of_a)[name] for name in self._known], axis=1)
        columns -= tool @ (tool.T @ columns)
        return tool, float(np.sqrt(max(np.sum((columns @ variance) * columns), 0.0) / _POSTURES))

    def _readings(self) -> Floats | None:
        """Readings (N, n), deg, in the joint region of both models; None without any."""
        first, second = (file.joint_region for file in self._files)
        lower, upper = np.maximum(first.min, second.min), np.minimum(first.max, second.max)
        if (lower >= upper).any():
            return None
        return np.asarray(np.random.default_rng(_SEED).uniform(lower, upper, (_POSTURES, len(lower))))


def _test(difference: Floats, variance: Floats) -> tuple[float, int, float]:
    """χ² of a difference (D,), its degrees of freedom, and the p-value of two tests: χ², and the largest in σ.

    Combinations without variance do not count. Both tests are corrected for their number (Bonferroni).
    """
    sigma = np.sqrt(np.maximum(np.diag(variance), 0.0))
    used = sigma > 0.0
    if not used.any():
        return 0.0, 0, 1.0
    difference, variance, sigma = difference[used], variance[np.ix_(used, used)], sigma[used]
    scaled = difference / sigma
    values, vectors = np.linalg.eigh(variance / np.outer(sigma, sigma))
    firm = values > _SINGULAR
    chi2, dof = float(np.sum((vectors[:, firm].T @ scaled) ** 2 / values[firm])), int(firm.sum())
    largest = 2.0 * float(normal_sf(np.abs(scaled).max())) * len(scaled)
    return chi2, dof, float(min(1.0, 2.0 * min(float(chi2_sf(chi2, dof)), largest)))


def _in_sigmas(change: ParameterChange) -> float:
    if change.sigma is None or change.difference is None:
        return -1.0
    return abs(change.difference) / change.sigma if change.sigma > 0.0 else 0.0


def _with_tool(model: RobotModel, tool: Floats, at: Floats) -> Floats:
    """TCPs (N, 3), mm, of the model with another tool (4, 4)."""
    poses: Floats = model.pose(at) @ np.linalg.inv(model.chain.tool_now) @ tool
    return poses[:, :3, 3]


def _moved_onto(points: Floats, others: Floats) -> Floats:
    """`points` (N, 3), carried nearest to `others` by a rigid motion."""
    pose = rigid_fit(points, others)
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def _without(basis: Floats, vectors: Floats) -> Floats:
    """`vectors` (N, 3) without their part in the space of the orthonormal `basis` (3N, k)."""
    flat = vectors.ravel()
    return np.asarray((flat - basis @ (basis.T @ flat)).reshape(-1, 3))
