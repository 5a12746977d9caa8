"""Unknowns of a fit and their priors: states, groups, tolerances."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.model.parameter import FRAMES, Group, Parameter, of_datum, of_point
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.kinematics import Bools, Floats, SerialChain

GEOMETRY = "geometry"
"""The name for all parameters of a link table: joint zeros and links."""

PLACED: frozenset[Group] = FRAMES
"""Groups that tie a robot to an instrument."""


def members(groups: frozenset[Group], chain: SerialChain) -> frozenset[Group]:
    """`groups` with `geometry` replaced by its groups; with screws without the (redundant) joint zeros."""
    if GEOMETRY not in groups:
        return groups
    return groups - {GEOMETRY} | ({"links"} if str(chain.convention) == "poe" else {"links", "zeros"})


@final
@dataclass(frozen=True, slots=True)
class Tolerances:
    """Priors before the measurement: 1 σ of each kind of parameter about the nominal value.

    `link_mm` and `angle_deg` hold for a table's lengths and angles, and for the places and tilts of axes; `tool_mm` and
    `tool_deg` for a taught tool; `lost_zero_deg` for a joint that has lost its mastering, by a crash or a new motor.
    The zero of a prismatic joint has `link_mm`, a lost one `lost_zero_mm`.
    `flat_mm` and `flat_rad` are flat priors (base and tool in an instrument's frame, sphere centres): too wide to
    affect a result, finite so that every problem is well posed. Each effect states its own prior.

    The defaults are estimates; no maker publishes these figures. A robot file states its make's own. Where the rows
    contradict them, the evidence scales them (`solver.evidence`): a tolerance that is too small costs rows, not truth.
    """

    link_mm: float = 0.5
    angle_deg: float = 0.05
    joint_zero_deg: float = 0.05
    tool_mm: float = 2.0
    tool_deg: float = 0.5
    lost_zero_deg: float = 5.0
    lost_zero_mm: float = 50.0
    flat_mm: float = 1000.0
    flat_rad: float = 1.0


@final
@dataclass(frozen=True, eq=False)
class State:
    """The state of a fit: the robot in each session, and the unknown points (S, 3), mm, in the measuring frame.

    models: one for each session, different only in base and tool. columns: for each, which of the `width` columns of a
    Jacobian each of its parameters has; the points' x, y, z follow, the datums are last. datums (D,): what each
    instrument with unknown zero would read at length 0, mm.
    """

    models: tuple[RobotModel, ...]
    points: Floats
    columns: tuple[Any, ...]
    datums: Floats = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def alone(cls, model: RobotModel, points: Floats | None = None) -> Self:
        """One session."""
        places = np.zeros((0, 3)) if points is None else points
        return cls((model,), places, (np.arange(len(model.parameters)),))

    @classmethod
    def of_sessions(
        cls,
        models: Sequence[RobotModel],
        own: Sequence[frozenset[Group]],
        points: Floats,
        datums: Floats | None = None,
    ) -> Self:
        """Several sessions; `own` names, for each after the first, which of base and tool are its own."""
        parameters = models[0].parameters
        columns, width = [np.arange(len(parameters))], len(parameters)
        for groups in own:
            mine = np.arange(len(parameters))
            apart = [index for index, parameter in enumerate(parameters) if parameter.group in groups & PLACED]
            mine[apart] = np.arange(width, width + len(apart))
            columns, width = [*columns, mine], width + len(apart)
        return cls(tuple(models), points, tuple(columns), np.zeros(0) if datums is None else datums)

    @property
    def model(self) -> RobotModel:
        """The robot in the first session."""
        return self.models[0]

    @property
    def points_at(self) -> int:
        """The first column of the points."""
        return 1 + max(int(columns.max()) for columns in self.columns)

    @property
    def datums_at(self) -> int:
        """The first column of the datums."""
        return self.points_at + self.points.size

    @property
    def of_points(self) -> slice:
        """The columns of the points."""
        return slice(self.points_at, self.datums_at)

    @property
    def width(self) -> int:
        """Number of columns of a Jacobian."""
        return self.datums_at + self.datums.size

    def spread(self, columns: Floats, session: int) -> Floats:
        """A session's columns (N, k, P of its model) as columns of the whole (N, k, `width`), the others 0."""
        if columns.shape[-1] == self.width:
            return columns
        result = np.zeros((*columns.shape[:-1], self.width))
        result[..., self.columns[session]] = columns
        return result


@final
@dataclass(frozen=True, eq=False)
class Unknowns:
    """All parameters of a fit in one row: the model's, each further session's own, the points' x, y, z, the datums.

    parameters (P); sigma (P,): prior 1 σ, in the parameters' units; free (P,): may change; start: expected values.
    prior (P, P): covariance in place of `sigma`, where more is known; parameters that are not free then have an
    uncertainty too, carried over into all results. pinned (H, P): combinations, in units of `sigma`, that stay
    at their start because they are unobservable; that does not make them certain: a row of length s > 1 has σ 1/s, one
    of length 1 the whole tolerance (`estimate`, *Pinned*, and `identify._unobservable_placements`, which makes them).
    """

    start: State
    parameters: tuple[Parameter, ...]
    sigma: Floats
    free: Bools
    prior: Floats | None = None
    pinned: Floats | None = None

    @classmethod
    def of(
        cls,
        start: State,
        points: Sequence[str],
        tolerances: Tolerances,
        *,
        flat: frozenset[Group] = frozenset(),
        sessions: Sequence[str] = (),
        datums: Sequence[str] = (),
        datum_sigmas: Sequence[float] = (),
        planes: Collection[int] = (),
    ) -> Self:
        """Every parameter of `start`, all free. Groups named `flat` have a flat prior.

        sessions: names of all after the first; their own parameters are called `base_x@NAME`, those of points
        `NAME_x`, datums `NAME_zero`. datum_sigmas (D,): prior 1 σ of the datums about 0, mm; none: flat. planes: which
        points are planes, with the three numbers of the pole.
        """
        model = start.model
        expected = _expected(model, flat, tolerances)
        robot: dict[int, tuple[Parameter, float]] = dict(enumerate(zip(model.parameters, expected, strict=True)))
        for columns, session in zip(start.columns[1:], sessions, strict=True):
            for column, parameter, sigma in zip(columns.tolist(), model.parameters, expected, strict=True):
                robot.setdefault(column, (parameter.in_session(session), sigma))
        parameters = [robot[column][0] for column in range(start.points_at)]
        parameters += [each for at, name in enumerate(points) for each in of_point(name, plane=at in planes)]
        parameters += [of_datum(name) for name in datums]
        of_robot = [robot[column][1] for column in range(start.points_at)]
        of_datums = datum_sigmas or [tolerances.flat_mm] * start.datums.size
        sigmas = np.concatenate([of_robot, np.full(start.points.size, tolerances.flat_mm), of_datums])
        return cls(start, tuple(parameters), sigmas, np.ones(len(parameters), bool))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each parameter (P,), as in files."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """Group of each parameter (P,)."""
        return tuple(parameter.group for parameter in self.parameters)

    def only(self, groups: frozenset[Group]) -> Self:
        """These unknowns with only `groups` free."""
        return replace(self, free=self.free & self.among(groups))

    def among(self, groups: frozenset[Group]) -> Bools:
        """Which parameters (P,) belong to `groups`."""
        wanted = members(groups, self.start.model.chain)
        return np.array([group in wanted for group in self.groups])

    def masked(self, free: Bools) -> Self:
        """These unknowns with only those at `free` (P,) free."""
        return replace(self, free=self.free & free)

    def with_prior_scale(self, factors: Mapping[Group, float]) -> Self:
        """These unknowns with the tolerances of some groups wider by a factor; or, with a prior model, with that much
        added as possible change since (`change`).
        """
        wider = np.array([factors.get(group, 1.0) for group in self.scaled_with])
        if self.prior is None:
            return replace(self, sigma=self.sigma * wider)
        return replace(self, prior=self.prior + np.diag((wider**2 - 1.0) * self.change * self.sigma**2))

    @property
    def scaled_with(self) -> tuple[str, ...]:
        """The set with which each parameter's (P,) prior is scaled: its group, or its band within that.

        Where a prior model's covariance is given, groups are scaled as a whole.
        """
        if self.prior is not None:
            return self.groups
        return tuple(parameter.scaled_with for parameter in self.parameters)

    @property
    def change(self) -> Floats:
        """Variance (P,), in tolerances, that each parameter gains where its group's factor² grows by 1.

        A robot's changes do not depend on how well it was known: all free parameters of a group gain alike, so that the
        root mean square of the 1 σ grows by the factor: with c = 1/mean(1/C_ii) the mean of (C_ii + (f² − 1) c)/C_ii is
        f². Without a prior model c = 1.
        """
        if self.prior is None:
            return np.ones(len(self.names))
        known, groups = np.diag(self.prior) / self.sigma**2, np.array(self.groups)
        result = np.zeros(len(known))
        for group in dict.fromkeys(self.groups):
            mine = self.free & (groups == group) & (known > 0.0)
            if mine.any():
                result[mine] = 1.0 / np.mean(1.0 / known[mine])
        return result

    @property
    def considered(self) -> Bools:
        """Which parameters (P,) are held although a prior model was not certain of them."""
        if self.prior is None:
            return np.zeros(len(self.names), bool)
        return np.asarray(~self.free & (np.diag(self.prior) > 0.0))

    def known(self, columns: Any) -> Floats:
        """Prior covariance (C, C) of the parameters at `columns` (C,), in tolerances."""
        if self.prior is None:
            return np.eye(len(columns))
        scale = self.sigma[columns]
        return np.asarray(self.prior[np.ix_(columns, columns)] / np.outer(scale, scale))

    def restarted(self, start: State) -> Self:
        """The same unknowns, expected at `start`."""
        return replace(self, start=start)

    @property
    def least(self) -> Floats:
        """The lowest deviation (P,) from the start that an effect allows; −inf where there is no bound."""
        result = np.full(len(self.names), -np.inf)
        for model, columns in zip(self.start.models, self.start.columns, strict=True):
            result[columns] = model.least - model.deviations
        return result

    @property
    def robot(self) -> int:
        """Count of the robot's parameters in its first session; the rest are placements and points."""
        return len(self.start.model.parameters)

    def state(self, deviations: Floats) -> State:
        """The state at `deviations` (P,) from the start."""
        start = self.start
        models = tuple(
            model.with_deviations(model.deviations + deviations[columns])
            for model, columns in zip(start.models, start.columns, strict=True)
        )
        points = start.points + deviations[start.of_points].reshape(-1, 3)
        return replace(start, models=models, points=points, datums=start.datums + deviations[start.datums_at :])


def _expected(model: RobotModel, flat: frozenset[Group], tolerances: Tolerances) -> list[float]:
    """Prior 1 σ of each parameter (P,) of a model, from the tolerances and its effects."""
    of_chain = model.parameters[: len(model.chain.parameters)]
    of_effects = [float(sigma) for effect in model.effects for sigma in effect.sigma]
    return [_sigma(parameter, flat, tolerances) for parameter in of_chain] + of_effects


def _sigma(parameter: Parameter, flat: frozenset[Group], tolerances: Tolerances) -> float:
    if parameter.group in flat:
        return tolerances.flat_rad if parameter.turns else tolerances.flat_mm
    if parameter.group == "tool":
        return float(np.deg2rad(tolerances.tool_deg)) if parameter.turns else tolerances.tool_mm
    if parameter.group == "zeros" and parameter.turns:
        return float(np.deg2rad(tolerances.joint_zero_deg))
    return float(np.deg2rad(tolerances.angle_deg)) if parameter.turns else tolerances.link_mm
