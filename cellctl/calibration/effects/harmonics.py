"""Errors that come round with the joint: an encoder disc off its centre, an oval gear, a ripple of either."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias, final

import numpy as np

from cellctl.calibration.postures import Postures
from cellctl.kinematics import Floats, SerialChain

EXPECTED_RAD = 3e-4
"""One minute of arc, an estimate. Joints 1 to 3 of the UR10 in the ipa-robot-accuracy data set: amplitudes of 0.6e-4 …
5e-4, once and twice per turn, all its 11 911 rows fitted together with their compliance."""

Wave: TypeAlias = tuple[int, int]
"""A joint, from 1, and how many waves it makes per turn."""


@final
@dataclass(frozen=True, slots=True)
class Harmonics:
    """Each joint's error at whole numbers of waves per turn: Σ s_m sin mq + c_m (cos mq − 1).

    joints: how many. orders: waves per turn of every joint: once (a disc off its centre) and twice (an oval, a coupling
    out of line). ripple: further waves as (joint from 1, waves per turn), as `find_ripple` has them. expected: prior
    1 σ of every amount about 0, rad. `harmonic{j}_s{m}`, `…_c{m}`, rad.
    The cosines are counted from the model angle 0, where all waves are nothing: `theta{j}` stays what it is without
    them, the error at that angle (with cos mq alone it would become the mean over a turn).
    needs: joints that go round half a turn or more at many angles; over less, slow waves look like the joint's zero.
    Of the first joint that leans (2, mostly) the once-per-turn pair is the same as its own weight's,
    `compliance{j}_{j}x`, `…y`: no measurement tells those apart.
    """

    joints: int
    orders: tuple[int, ...] = (1, 2)
    ripple: tuple[Wave, ...] = ()
    expected: float = EXPECTED_RAD

    @property
    def waves(self) -> tuple[Wave, ...]:
        """All waves, joint by joint, then the ripple; each once."""
        regular = tuple((j + 1, m) for j in range(self.joints) for m in self.orders)
        return tuple(dict.fromkeys(regular + self.ripple))

    @property
    def group(self) -> str:
        """`harmonics`."""
        return "harmonics"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Sine and cosine of each wave."""
        return tuple(f"harmonic{j}_{part}{m}" for j, m in self.waves for part in "sc")

    @property
    def units(self) -> tuple[str, ...]:
        """Rad."""
        return ("rad",) * len(self.parameters)

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, rad."""
        return np.full(len(self.parameters), self.expected)

    @property
    def least(self) -> Floats:
        """−inf: waves have any phase."""
        return np.full(len(self.parameters), -np.inf)

    def turns(self, nominal: SerialChain, at: Postures) -> Floats:
        """Φ (N, n, K): each wave in the row of its joint."""
        joints, orders = np.array(self.waves, int).reshape(-1, 2).T
        phase = at.q[:, joints - 1] * orders
        result = np.zeros((len(at), self.joints, 2 * joints.size))
        sines = 2 * np.arange(joints.size)
        result[:, joints - 1, sines] = np.sin(phase)
        result[:, joints - 1, sines + 1] = np.cos(phase) - 1.0
        return result

    def shifts(self, nominal: SerialChain, at: Postures) -> None:
        """None: joints turn, and carry the tool with them."""
