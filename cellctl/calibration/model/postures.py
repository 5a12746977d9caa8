"""Where the robot stood when something was measured, and what may bend, warm or push it there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats

Condition: TypeAlias = Literal["approach", "delta_t", "payload"]
"""What may be noted of a robot besides where its joints are."""


@final
@dataclass(frozen=True, eq=False)
class Postures:
    """Joint angles of N rows with the conditions of each; a condition that nobody noted is None.

    q (N, n): model angles, rad. approach (N, n): which way each joint last moved, in the model's sense: 1, −1, or 0
    where it is not known. delta_t (N,): degrees Celsius above the temperature at which the model's lengths hold.
    payload (N,): mass at the tool centre point, kg, besides what the tool itself weighs.
    """

    q: Floats
    approach: Floats | None = None
    delta_t: Floats | None = None
    payload: Floats | None = None

    @classmethod
    def of(cls, at: Self | ArrayLike) -> Self:
        """Postures as they are; angles (..., n) as N postures without conditions."""
        if isinstance(at, cls):
            return at
        angles = np.asarray(at, float)
        return cls(angles.reshape(-1, angles.shape[-1]))

    def pick(self, which: Any) -> Self:
        """The rows at an index array, slice or mask."""
        parts = (self.approach, self.delta_t, self.payload)
        return type(self)(self.q[which], *(None if part is None else part[which] for part in parts))

    def __len__(self) -> int:
        return len(self.q)


At: TypeAlias = Postures | ArrayLike
"""Postures, or model angles (..., n), rad, of a robot whose conditions nobody noted."""


def varies(values: Floats | None) -> bool:
    """Whether a condition (N,) was noted, and is not always the same."""
    return values is not None and bool(values.max() - values.min() > 1e-9)
