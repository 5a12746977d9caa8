"""The interface of a kind of measurement to the estimator, and the base of the kinds at joint angles."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields, replace
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.kinematics import Bools, Floats


class Rows(Protocol):
    """N measurements of k numbers each, with independent errors."""

    @property
    def sigma(self) -> Floats:
        """Standard deviations (N, k), mm or rad."""
        ...

    @property
    def quantities(self) -> tuple[str, ...]:
        """Kind of each of the k numbers: `position`, `rotation`, …; noise is judged for each kind separately."""
        ...

    def residual(self, state: State) -> Floats:
        """Model minus measurement (N, k), mm or rad."""
        ...

    def jacobian(self, state: State) -> Floats:
        """Derivative of `residual` (N, k, P) by all parameters, in the order of `Unknowns`."""
        ...

    def errors(self, state: State) -> Floats:
        """Distance (N,) between model and measurement as shown to people, mm."""
        ...

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        ...

    def noisier(self, factors: Floats) -> Self:
        """The same rows with each of the k standard deviations times `factors` (k,)."""
        ...

    def __len__(self) -> int: ...


class Reachable(Protocol):
    """Where rows like those of a block could be measured (`cellctl.planning`). tried: the number of goals."""

    @property
    def tried(self) -> int: ...

    def anywhere(self) -> Postures:
        """Postures in and near the measured volume."""
        ...

    def at(self, goals: Floats, normals: Floats | None = None) -> tuple[Postures, Any]:
        """Postures (K) with the TCP at some of `goals` (tried, 3), mm, and the indices (K,) of these goals.

        normals (tried, 3): from the surface; the tool leans away from them no more than it did in the block's rows.
        """
        ...


class RowsAtJoints(ABC):
    """A block of rows of one kind, measured at joint angles in one session: common parts, and the properties that each
    kind defines. A new kind is one class.

    of_instrument: whether they are measured in an instrument's own frame, so that they register base and tool.
    of_planes: whether their fixed points are planes (`State.points` has the poles). has_length: whether they contain a
    length, without which the robot's size is unobservable. along_line: whether a row is one distance along a line
    (`normals`). one, many: names of such a row. noun, visits, visits_at_least: names of their fixed points and of the
    rows at them, and how many rows find such a point and check that they agree. at_point: whether the TCP itself is at
    the fixed point. in_setup_check: whether the set-up check can judge such rows (`squared_misfits`, or `positions`);
    it leaves others out, and says so. model_error_scale: factor on σ of predictions where only such rows
    show that the model lacks something (decision 67): rows at fixed points show a part of what it lacks, the places of
    the points and the geometry take up the rest. model_error_freedom: the degrees of freedom of that σ (decision 76).
    """

    at: At
    sigma: Floats
    session: int

    of_instrument: ClassVar[bool] = False
    of_planes: ClassVar[bool] = False
    has_length: ClassVar[bool] = True
    along_line: ClassVar[bool] = False
    one: ClassVar[str] = "row"
    many: ClassVar[str] = "rows"
    noun: ClassVar[str] = "point"
    visits: ClassVar[str] = "rows"
    visits_at_least: ClassVar[int] = 0
    at_point: ClassVar[bool] = False
    in_setup_check: ClassVar[bool] = False
    model_error_scale: ClassVar[float] = 1.25
    model_error_freedom: ClassVar[float] = 8.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", Postures.of(self.at))

    @property
    def postures(self) -> Postures:
        """The robot's postures, N rows."""
        return Postures.of(self.at)

    @property
    def q(self) -> Floats:
        """Model angles (N, n), rad."""
        return self.postures.q

    @property
    @abstractmethod
    def quantities(self) -> tuple[str, ...]:
        """See `Rows`."""

    @property
    def of_length(self) -> Bools:
        """Which of the k numbers of a row are lengths, mm; the others are angles."""
        return np.array([quantity != "rotation" for quantity in self.quantities])

    @abstractmethod
    def residual(self, state: State) -> Floats:
        """See `Rows`."""

    @abstractmethod
    def jacobian(self, state: State) -> Floats:
        """See `Rows`."""

    @abstractmethod
    def errors(self, state: State) -> Floats:
        """See `Rows`."""

    def deviation(self, state: State) -> Floats:
        """`residual` (N, k) along the measuring frame's axes, also where rows are weighted along others."""
        return self.residual(state)

    @property
    def positions(self) -> Floats | None:
        """TCPs (N, 3), mm, that an instrument measured; None without them."""
        return None

    @property
    def orientations(self) -> Floats | None:
        """Rotations (N, 3, 3) of the tool that an instrument measured; None without them."""
        return None

    @property
    def distances(self) -> Floats | None:
        """Measured distances (N,), mm, of the TCPs from the fixed points, with the instrument's zero; None without
        them.
        """
        return None

    def lengths(self, state: State) -> Floats:
        """`distances` less the datums of `state` (N,), mm; NaN without distances."""
        if self.distances is None:
            return np.full(len(self), np.nan)
        return np.asarray(self.distances - np.append(state.datums, 0.0)[self.zeros])  # -1: the last one, 0

    @property
    def visited(self) -> Any:
        """Index of each row's fixed point (N,); −1: none."""
        return getattr(self, "point", np.full(len(self), -1))

    @property
    def zeros(self) -> Any:
        """Index (N,) of the datum from which each row's length is counted; −1: a known zero, or no length."""
        return np.full(len(self), -1)

    def telling(self, point: int) -> Bools:
        """Which rows (N,) measure the place of point number `point`, without a datum."""
        return np.asarray((self.visited == point) & (self.zeros < 0))

    def place(self, model: RobotModel) -> Floats:
        """Place (3,), mm, of the fixed point of all these rows; of a plane its pole."""
        return np.asarray(model.tcp(self.postures).mean(axis=0))

    def with_positions(self, xyz: Floats) -> Self:
        """These rows with other measured TCPs (N, 3), mm; the same rows where the kind measures none."""
        return self

    def with_orientations(self, rotations: Floats) -> Self:
        """These rows with other measured rotations (N, 3, 3); the same rows where the kind measures none."""
        return self

    def with_distances(self, distances: Floats) -> Self:
        """These rows with other measured distances (N,), mm; the same rows where the kind measures none."""
        return self

    def proposed(self, state: State, reachable: Reachable) -> Self | None:
        """Rows of this kind that could be measured next, with the readings that `state` predicts; may be empty.

        None: the kind does not state where. The page of a fit then proposes none of them, and says so.
        """
        return None

    def usual_sigma(self, count: int) -> Floats:
        """σ (count, k) of as many further rows: the median of these."""
        return np.tile(np.median(self.sigma, axis=0), (count, 1))

    def errors_and_turns(self, state: State) -> tuple[Floats, Floats | None]:
        """`errors`, and angles (N,), rad, between model and measured orientations; None where it measures none."""
        return self.errors(state), None

    def squared_misfits(self, tcps: Floats) -> Floats:
        """Squared distances (C, N), mm², in any order, of the TCPs `tcps` (C, N, 3) of C candidate robots from the
        fixed points that fit each candidate best. The set-up check ranks candidates by them, without a registration.
        """
        raise NotImplementedError(f"{type(self).__name__} is in the set-up check without distances of its own")

    def normals(self, state: State) -> Floats:
        """Unit vectors (N, 3) of the line along which each row is a distance; NaN for other rows."""
        return np.full((len(self), 3), np.nan)

    def anywhere(self, state: State) -> Floats:
        """TCPs (N, 3), mm, at which each row would measure the same, as far apart as possible."""
        return self._model(state).tcp(self.postures)

    def moved_to(self, postures: Postures, model: RobotModel) -> Self:
        """The same measurements at other postures of `model`."""
        return self.changed(at=postures)

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask: every array of the kind, and its postures."""
        names = [each.name for each in fields(self)]  # type: ignore[arg-type]  # every kind is a dataclass
        arrays = [each for each in names if each not in ("at", "session")]
        given = {name: values for name in arrays if (values := getattr(self, name)) is not None}
        return self.changed(at=self.postures.pick(which), **{name: values[which] for name, values in given.items()})

    def changed(self, **values: Any) -> Self:
        """These rows with other values of some fields."""
        return replace(self, **values)  # type: ignore[type-var]  # every kind is a dataclass

    def __len__(self) -> int:
        return len(self.sigma)

    def noisier(self, factors: Floats) -> Self:
        """The same rows with each of the k standard deviations times `factors` (k,)."""
        return self.changed(sigma=self.sigma * factors)

    def _model(self, state: State) -> RobotModel:
        return state.models[self.session]


def with_points(columns: Floats, of_point: Floats, point: Any, state: State, session: int) -> Floats:
    """The robot's `columns` (N, k, P of its model) and those of each row's point (N, k, 3) as columns of the state."""
    result = np.zeros((*columns.shape[:-1], state.width))
    result[..., state.columns[session]] = columns
    points = np.zeros((len(columns), columns.shape[1], len(state.points), 3))
    points[np.arange(len(columns)), :, point] = of_point
    result[..., state.of_points] = points.reshape(*columns.shape[:2], 3 * len(state.points))
    return result
