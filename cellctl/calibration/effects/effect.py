"""What every effect that is no geometry has in common: it is linear in its amounts, at joints that are nominal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, final

import numpy as np

from cellctl.calibration.model.postures import Postures
from cellctl.kinematics import Floats, SerialChain


@final
@dataclass(frozen=True, eq=False)
class OwnTurns:
    """Turns of which each amount has one joint to itself: joints (K,), from 0; values (N, K), rad per unit. Hundreds of
    amounts are six times smaller so than as Φ (N, n, K).
    """

    joints: Any
    values: Floats

    def total(self, amounts: Floats, joints: int) -> Floats:
        """What all amounts (K,) together turn each joint by (N, n), rad."""
        result = np.zeros((len(self.values), joints))
        for joint in range(joints):
            mine = self.joints == joint
            result[:, joint] = self.values[:, mine] @ amounts[mine]
        return result

    def columns(self, arms: Floats) -> Floats:
        """How the tool moves (N, 6, K) with the amounts; arms (N, 6, n): with the joints."""
        return np.asarray(arms[:, :, self.joints] * self.values[:, None, :])

    def dense(self, joints: int) -> Floats:
        """Φ (N, n, K)."""
        result = np.zeros((len(self.values), joints, len(self.joints)))
        result[:, self.joints, np.arange(len(self.joints))] = self.values
        return result


class Effect(Protocol):
    """A cause of error with K amounts κ. It turns the joints by Φκ, and shifts the tool by Ψκ.

    Both are worked out on the *nominal* chain in its own base frame (`with_base(identity)`, no deviations): an error of
    a thousandth in where a load pulls is a thousandth of a thousandth at the tool, and so every derivative stays exact
    and closed. `parameters` (K,): names; `units`: `rad`, `1/K`, …; `sigma` (K,): prior 1 σ in those units.
    """

    @property
    def group(self) -> str:
        """Name of the kind, by which it is freed or held: `compliance`, `backlash`, …."""
        ...

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names (K,), each unlike any other of a model."""
        ...

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each amount (K,)."""
        ...

    @property
    def sigma(self) -> Floats:
        """How large each amount (K,) is expected to be, 1 σ."""
        ...

    @property
    def least(self) -> Floats:
        """What no amount (K,) is below, in its unit: 0 where a negative one has no meaning, −inf elsewhere."""
        ...

    def turns(self, nominal: SerialChain, at: Postures) -> Floats | OwnTurns | None:
        """Φ (N, n, K): rad of each joint per unit of each amount; None where the effect turns no joint."""
        ...

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats | None:
        """Ψ (N, 3, K): mm of the tool centre point, in the robot's base frame, per unit; None where nothing shifts."""
        ...
