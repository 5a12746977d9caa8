"""A row kind of another package: heights of the TCP above a level table, as a height gauge shows them."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cellctl.calibration import Measured
from cellctl.calibration.model.postures import At
from cellctl.formats.measurements import Reading, RowKind
from cellctl.formats.measurements.columns import distance_sigma


@dataclass(frozen=True, eq=False)
class HeightRows(Measured):
    """height (N,), mm, in the instrument's frame; sigma (N, 1), mm."""

    at: At
    height: Any
    sigma: Any
    session: int = 0

    of_instrument: ClassVar = True
    along_line: ClassVar = True
    one: ClassVar = "height"
    many: ClassVar = "heights"

    @property
    def quantities(self):
        return ("height",)

    def residual(self, state):
        return (self._model(state).tcp(self.postures)[:, 2] - self.height)[:, None]

    def jacobian(self, state):
        return state.spread(self._model(state).jacobian(self.postures)[:, 2:3], self.session)

    def normals(self, state):
        return np.tile([0.0, 0.0, 1.0], (len(self), 1))

    def errors(self, state):
        return np.abs(self.residual(state)[:, 0])


@dataclass(frozen=True, eq=False)
class Heights(Reading):
    """The column height (N,), mm, and the σ of its rows (N, 1), mm."""

    height: Any
    sigma: Any

    @classmethod
    def of(cls, sieve, robot, rows, artefact):
        return cls(np.array(sieve.numbers("height", rows=rows)), distance_sigma(sieve, robot, rows))

    def block(self, rows, at, session, points, datums):
        return HeightRows(at, self.height[rows], self.sigma[rows], session)


KIND = RowKind(rows=HeightRows, read=Heights.of, one="a height", many="heights", columns=("height",))
