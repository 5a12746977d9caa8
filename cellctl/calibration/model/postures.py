"""Postures of the robot at its measurements, with the conditions there: approach, temperature, payload, currents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats

Condition: TypeAlias = Literal["approach", "delta_t", "payload", "currents"]
"""Conditions that may be recorded besides the joint angles."""


@final
@dataclass(frozen=True, eq=False)
class Postures:
    """Joint angles of N rows with the conditions of each; a condition that was not recorded is None.

    q (N, n): model angles, rad. approach (N, n): direction of each joint's last move, in the model's sense: 1, −1, or 0
    where it is not known. delta_t (N,): degrees Celsius above the temperature at which the model's lengths hold.
    payload (N,): mass that the robot carries, kg, without the tool's own. payload_at (N, 3): its centre of gravity in
    the flange frame, mm; None: at the TCP. currents (N, n): of the motors, A, in the model's sense; NaN where a row has
    none.
    """

    q: Floats
    approach: Floats | None = None
    delta_t: Floats | None = None
    payload: Floats | None = None
    payload_at: Floats | None = None
    currents: Floats | None = None

    @classmethod
    def of(cls, at: Self | ArrayLike) -> Self:
        """Postures as they are; angles (..., n) as N postures without conditions."""
        if isinstance(at, cls):
            return at
        angles = np.asarray(at, float)
        return cls(angles.reshape(-1, angles.shape[-1]))

    def pick(self, which: Any) -> Self:
        """The rows at an index array, slice or mask."""
        parts = (self.approach, self.delta_t, self.payload, self.payload_at, self.currents)
        return type(self)(self.q[which], *(None if part is None else part[which] for part in parts))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """All rows of `parts` (one or more); a condition that one of them lacks is left out."""
        conditions = (
            [part.approach for part in parts],
            [part.delta_t for part in parts],
            [part.payload for part in parts],
            [part.payload_at for part in parts],
            [part.currents for part in parts],
        )
        known: list[Floats | None] = []
        for rows in conditions:
            there = [row for row in rows if row is not None]
            known.append(np.concatenate(there) if len(there) == len(rows) else None)
        return cls(np.concatenate([part.q for part in parts]), *known)

    def __len__(self) -> int:
        return len(self.q)


At: TypeAlias = Postures | ArrayLike
"""Postures, or model angles (..., n), rad, of a robot whose conditions were not recorded."""


def varies(values: Floats | None) -> bool:
    """Whether a condition (N,) was recorded, and is not constant."""
    return values is not None and bool(values.max() - values.min() > 1e-9)
