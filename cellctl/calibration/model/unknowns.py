"""What a fit may change, and how far it is expected to: states, groups, tolerances, priors."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.effects import Effect, Harmonics
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.kinematics import Bools, Floats, SerialChain

Group: TypeAlias = str
"""Parameters that are freed or held together: base, tool, zeros, links, points, datums, or an effect's own group."""

GEOMETRY = "geometry"
"""The name for all that a table of links holds: joint zeros and links."""

PLACED: frozenset[Group] = frozenset({"base", "tool"})
"""What ties a robot to an instrument."""


def members(groups: frozenset[Group], chain: SerialChain) -> frozenset[Group]:
    """`groups` with `geometry` replaced by what it stands for; screws need no joint zeros of their own beside it."""
    if GEOMETRY not in groups:
        return groups
    return groups - {GEOMETRY} | ({"links"} if str(chain.convention) == "poe" else {"links", "zeros"})


@final
@dataclass(frozen=True, slots=True)
class Tolerances:
    """What is known before the measurement: 1 σ of each kind of parameter about the nominal value.

    `link_mm` and `angle_deg` hold for a table's lengths and angles, and for the places and tilts of axes; `tool_mm` and
    `tool_deg` for a taught tool; `lost_zero_deg` for a joint that has lost its mastering, by a crash or a new motor.
    `flat_mm` and `flat_rad` stand for *nothing is known* (base and tool in an instrument's frame, sphere centres): so
    wide that they move no result, finite so that every problem is well posed. What an effect expects, it says itself.
    """

    link_mm: float = 0.5
    angle_deg: float = 0.05
    joint_zero_deg: float = 0.05
    tool_mm: float = 2.0
    tool_deg: float = 0.5
    lost_zero_deg: float = 5.0
    flat_mm: float = 1000.0
    flat_rad: float = 1.0


@final
@dataclass(frozen=True, eq=False)
class State:
    """Where a fit stands: the robot in each session, and the unknown points (S, 3), mm, in the measuring frame.

    models: one for each session, alike but for base and tool. columns: for each, which of the `width` columns of a
    Jacobian each of its parameters has; the points' x, y, z come after them, the datums last. datums (D,): what each
    instrument whose zero nobody knows would show at no length at all, mm.
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
        """Several sessions; `own` names for each after the first which of base and tool it has to itself."""
        names = models[0].parameters
        columns, width = [np.arange(len(names))], len(names)
        for groups in own:
            mine = np.arange(len(names))
            apart = [index for index, name in enumerate(names) if group_of(models[0], name) in groups & PLACED]
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
        """How many columns a Jacobian has."""
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

    names, groups (P); sigma (P,): prior 1 σ, in the parameters' units; free (P,): may change; start: where each is
    expected. prior (P, P): covariance in place of `sigma`, where more is known than that; those not free are then not
    certain either: what they are not known to carries over into everything that is found. pinned (H, P): combinations,
    in units of `sigma`, that stay where they start because nothing can see them; they are not certain by that.
    """

    start: State
    names: tuple[str, ...]
    groups: tuple[Group, ...]
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
    ) -> Self:
        """Every parameter of `start`, all free. In groups named `flat`, nothing is known beforehand.

        sessions: names of those after the first: their own parameters are called `base_x@NAME`. Those of points are
        called `NAME_x`, datums `NAME_zero`.
        """
        model = start.model
        names = list(model.parameters) + [""] * (start.points_at - len(model.parameters))
        for columns, session in zip(start.columns[1:], sessions, strict=True):
            for column, name in zip(columns, model.parameters, strict=True):
                names[column] = names[column] or f"{name}@{session}"
        sigma = [_sigma(model, name.partition("@")[0], flat, tolerances) for name in names]
        groups = [group_of(model, name.partition("@")[0]) for name in names]
        names += [f"{_told_apart(point)}_{axis}" for point in points for axis in "xyz"]
        names += [f"{datum}_zero" for datum in datums]
        sigma += [tolerances.flat_mm] * (start.points.size + start.datums.size)
        groups += ["points"] * start.points.size + ["datums"] * start.datums.size
        return cls(start, tuple(names), tuple(groups), np.array(sigma), np.ones(len(names), bool))

    def only(self, groups: frozenset[Group]) -> Self:
        """These unknowns with none but `groups` free."""
        return replace(self, free=self.free & self.among(groups))

    def among(self, groups: frozenset[Group]) -> Bools:
        """Which parameters (P,) belong to `groups`."""
        wanted = members(groups, self.start.model.chain)
        return np.array([group in wanted for group in self.groups])

    def masked(self, free: Bools) -> Self:
        """These unknowns with none but those at `free` (P,) free."""
        return replace(self, free=self.free & free)

    def loosened(self, factors: Mapping[Group, float]) -> Self:
        """These unknowns with the tolerances of some groups wider by a factor; or, of an older model, with as much more
        that may have changed since (`change`).
        """
        wider = np.array([factors.get(group, 1.0) for group in self.scaled_with])
        if self.prior is None:
            return replace(self, sigma=self.sigma * wider)
        return replace(self, prior=self.prior + np.diag((wider**2 - 1.0) * self.change * self.sigma**2))

    @property
    def scaled_with(self) -> tuple[str, ...]:
        """What the prior of each parameter (P,) is scaled together with: its group; of harmonics its joint's band.

        Where a prior model's covariance is given, groups are scaled as a whole.
        """
        if self.prior is not None:
            return self.groups
        result = list(self.groups)
        for model, columns in zip(self.start.models, self.start.columns, strict=True):
            bands = {name: band for effect in model.effects for name, band in banded(effect)}
            for column, name in zip(columns, model.parameters, strict=True):
                result[column] = bands.get(name, result[column])
        return tuple(result)

    @property
    def change(self) -> Floats:
        """Variance (P,), in tolerances, that each parameter gains where its group's factor² grows by 1.

        A robot changes without regard to how well it was known: all that is free of a group gains alike, so much that
        the 1 σ grow by the factor in the root mean square. Without an older model that is 1.
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
    def doubted(self) -> Bools:
        """Which parameters (P,) are held although an older model was not certain of them."""
        if self.prior is None:
            return np.zeros(len(self.names), bool)
        return np.asarray(~self.free & (np.diag(self.prior) > 0.0))

    def known(self, columns: Any) -> Floats:
        """What is known beforehand of the parameters at `columns` (C,): their covariance (C, C), in tolerances."""
        if self.prior is None:
            return np.eye(len(columns))
        scale = self.sigma[columns]
        return np.asarray(self.prior[np.ix_(columns, columns)] / np.outer(scale, scale))

    def restarted(self, start: State) -> Self:
        """The same unknowns, expected at `start`."""
        return replace(self, start=start)

    @property
    def least(self) -> Floats:
        """The lowest deviation (P,) from the start that an effect allows; −inf where nothing is said of that."""
        result = np.full(len(self.names), -np.inf)
        for model, columns in zip(self.start.models, self.start.columns, strict=True):
            result[columns] = model.least - model.deviations
        return result

    @property
    def robot(self) -> int:
        """How many parameters are those of the robot in its first session; the rest are placements and points."""
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


def banded(effect: Effect) -> list[tuple[str, str]]:
    """The amounts of `effect` that do not all share one prior scale, each with the name of its own."""
    return list(zip(effect.parameters, effect.bands, strict=True)) if isinstance(effect, Harmonics) else []


def group_of(model: RobotModel, name: str) -> Group:
    """The group that parameter `name` of a model belongs to."""
    if (known := model.expected_amounts.get(name)) is not None:
        return known[0]
    if name.startswith(("base_", "tool_")):
        return name.partition("_")[0]
    return "zeros" if re.fullmatch(r"theta\d+", name) else "links"


def _told_apart(point: str) -> str:
    """A point's name, of which `_x` makes no name of the robot's own: a sphere may well be called `tool`."""
    return f"point {point}" if point in ("base", "tool") else point


def _sigma(model: RobotModel, name: str, flat: frozenset[Group], tolerances: Tolerances) -> float:
    if (known := model.expected_amounts.get(name)) is not None:
        return known[1]
    turns = bool(model.parameter_turns[model.parameters.index(name)])
    if (group := group_of(model, name)) in flat:
        return tolerances.flat_rad if turns else tolerances.flat_mm
    if group == "tool":
        return float(np.deg2rad(tolerances.tool_deg)) if turns else tolerances.tool_mm
    if group == "zeros":
        return float(np.deg2rad(tolerances.joint_zero_deg))
    return float(np.deg2rad(tolerances.angle_deg)) if turns else tolerances.link_mm
