"""What every kind of measurement offers the estimator, and what the kinds at joint angles have in common."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol, Self

import numpy as np

from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.kinematics import Floats


class Rows(Protocol):
    """N measurements of k numbers each, with independent errors."""

    @property
    def sigma(self) -> Floats:
        """Standard deviations (N, k), mm or rad."""
        ...

    @property
    def quantities(self) -> tuple[str, ...]:
        """What each of the k numbers is: `position`, `rotation`, …; noise is judged for each kind by itself."""
        ...

    def residual(self, state: State) -> Floats:
        """Model minus measurement (N, k), mm or rad."""
        ...

    def jacobian(self, state: State) -> Floats:
        """Derivative of `residual` (N, k, P) by all parameters, in the order of `Unknowns`."""
        ...

    def errors(self, state: State) -> Floats:
        """Distance (N,) between model and measurement as people speak of it, mm."""
        ...

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        ...

    def noisier(self, factors: Floats) -> Self:
        """The same rows with each of the k standard deviations times `factors` (k,)."""
        ...

    def __len__(self) -> int: ...


class RowsAtJoints:
    """What the kinds measured at joint angles have in common."""

    at: At
    sigma: Floats
    session: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", Postures.of(self.at))

    @property
    def postures(self) -> Postures:
        """Where the robot stood, N rows."""
        return Postures.of(self.at)

    @property
    def q(self) -> Floats:
        """Model angles (N, n), rad."""
        return self.postures.q

    def __len__(self) -> int:
        return len(self.sigma)

    def noisier(self, factors: Floats) -> Self:
        """The same rows with each of the k standard deviations times `factors` (k,)."""
        return replace(self, sigma=self.sigma * factors)  # type: ignore[type-var]  # every kind is a dataclass

    def _model(self, state: State) -> RobotModel:
        return state.models[self.session]


def with_points(columns: Floats, of_point: Floats, point: Any, state: State, session: int) -> Floats:
    """The robot's `columns` (N, k, P of its model) and each row's own point's (N, k, 3) as columns of the whole."""
    result = np.zeros((*columns.shape[:-1], state.width))
    result[..., state.columns[session]] = columns
    points = np.zeros((len(columns), columns.shape[1], len(state.points), 3))
    points[np.arange(len(columns)), :, point] = of_point
    result[..., state.of_points] = points.reshape(*columns.shape[:2], 3 * len(state.points))
    return result
