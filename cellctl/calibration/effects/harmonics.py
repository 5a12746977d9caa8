"""Errors that come round with the joint: an encoder disc off its centre, an oval gear, a ripple of either."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration.postures import Postures
from cellctl.kinematics import Floats, SerialChain

EXPECTED_RAD = 3e-4
"""One minute of arc, an estimate. Joints 1 to 3 of the UR10 in the ipa-robot-accuracy data set: amplitudes of 0.6e-4 …
5e-4, once and twice per turn, all its 11 911 rows fitted together with their compliance."""


@final
@dataclass(frozen=True, slots=True)
class Harmonics:
    """Each joint's error at whole numbers of waves per turn: Σ s_m sin mq + c_m (cos mq − 1).

    joints: how many. orders: waves per turn; once (a disc off its centre) and twice (an oval, a coupling out of line)
    by default. expected: prior 1 σ of every amount about 0, rad. `harmonic{j}_s{m}`, `…_c{m}`, rad.
    The cosines are counted from the model angle 0, where all waves are nothing: `theta{j}` stays what it is without
    them, the error at that angle (with cos mq alone it would become the mean over a turn).
    needs: joints that go round half a turn or more at many angles; over less, slow waves look like the joint's zero.
    Of the first joint that leans (2, mostly) the once-per-turn pair is the same as its own weight's,
    `compliance{j}_{j}x`, `…y`: no measurement tells those apart.
    """

    joints: int
    orders: tuple[int, ...] = (1, 2)
    expected: float = EXPECTED_RAD

    @property
    def group(self) -> str:
        """`harmonics`."""
        return "harmonics"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Sine and cosine of each order, joint by joint."""
        return tuple(f"harmonic{j + 1}_{wave}{m}" for j in range(self.joints) for m in self.orders for wave in "sc")

    @property
    def units(self) -> tuple[str, ...]:
        """Rad."""
        return ("rad",) * len(self.parameters)

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, rad."""
        return np.full(len(self.parameters), self.expected)

    def turns(self, nominal: SerialChain, at: Postures) -> Floats:
        """Φ (N, n, K): each joint's waves in its own row."""
        phase = at.q[..., None] * np.array(self.orders, float)
        waves = np.stack([np.sin(phase), np.cos(phase) - 1.0], axis=-1)
        result = np.zeros((len(at), self.joints, self.joints, len(self.orders), 2))
        own = np.arange(self.joints)
        result[:, own, own] = waves
        return result.reshape(len(at), self.joints, len(self.parameters))

    def shifts(self, nominal: SerialChain, at: Postures) -> None:
        """None: joints turn, and carry the tool with them."""
