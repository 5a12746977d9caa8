"""A row kind: height of the TCP above a level table, as a height gauge shows it, in the column `height`."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self, final

import numpy as np

from cellctl.calibration import Measured, Postures, State
from cellctl.formats import Artefact, Reading, RobotFile, RowKind, Sieve, distance_sigma
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class HeightRows(Measured):
    """For the fit: height (N,), mm, in the instrument's frame; sigma (N, 1), mm; at: the postures."""

    at: Postures
    height: Any
    sigma: Any
    session: int = 0

    of_instrument: ClassVar[bool] = True
    along_line: ClassVar[bool] = True
    one: ClassVar[str] = "height"
    many: ClassVar[str] = "heights"

    @property
    def quantities(self) -> tuple[str, ...]:
        """The kind of the one number of a row; noise is estimated for each kind."""
        return ("height",)

    def residual(self, state: State) -> Floats:
        """Model less measurement (N, 1), mm."""
        return np.asarray((self._model(state).tcp(self.postures)[:, 2] - self.height)[:, None])

    def jacobian(self, state: State) -> Floats:
        """Derivative of `residual` (N, 1, P) by all parameters of the fit."""
        return state.spread(self._model(state).jacobian(self.postures)[:, 2:3], self.session)

    def normals(self, state: State) -> Floats:
        """The vertical (N, 3): the line along which a row is measured."""
        return np.tile([0.0, 0.0, 1.0], (len(self), 1))

    def errors(self, state: State) -> Floats:
        """Size of the residual (N,), mm, for people."""
        return np.abs(self.residual(state)[:, 0])


@final
@dataclass(frozen=True, eq=False)
class Heights(Reading):
    """From the file: the column `height` (N,), mm, and σ of its rows (N, 1), mm."""

    height: Any
    sigma: Any

    @classmethod
    def of(cls, sieve: Sieve, robot: RobotFile, rows: Collection[int], artefact: Artefact | None) -> Self:
        """The cells at `rows`; a row with a bad one is rejected by the sieve."""
        return cls(np.array(sieve.numbers("height", rows=rows)), distance_sigma(sieve, robot, rows))

    def block(self, rows: list[int], at: Postures, session: int, points: Any, datums: Sequence[str]) -> HeightRows:
        """See `Reading`."""
        return HeightRows(at, self.height[rows], self.sigma[rows], session)


KIND = RowKind(rows=HeightRows, read=Heights.of, one="a height", many="heights", columns=("height",))
