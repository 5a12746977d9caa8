"""Errors that come round with the joint: an encoder disc off its centre, an oval gear."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration.postures import Postures
from cellctl.kinematics import Floats, SerialChain

EXPECTED_RAD = 1e-4
"""20 seconds of arc: an encoder disc 3 µm off the centre of a track of 30 mm radius."""

WAVES = ("s1", "c1", "s2", "c2")


@final
@dataclass(frozen=True, slots=True)
class Harmonics:
    """Each joint's error once and twice per turn: s1 sin q + c1 (cos q − 1) + s2 sin 2q + c2 (cos 2q − 1).

    joints: how many. `harmonic{j}_s1` … `_c2`, rad. The cosines are counted from the model angle 0, where all four are
    nothing: `theta{j}` stays what it is without them, the error at that angle (with cos q alone it would become the
    mean over a turn, and lose its worth as a mastering offset).
    needs: joints that go round half a turn or more; over less, they look like the zero and the links' weight. Of the
    first joint that leans, the once-per-turn pair is the same as its own weight's, `compliance{j}_{j}x`, `…y`.
    """

    joints: int
    expected: float = EXPECTED_RAD

    @property
    def group(self) -> str:
        """`harmonics`."""
        return "harmonics"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Four for each joint."""
        return tuple(f"harmonic{j + 1}_{wave}" for j in range(self.joints) for wave in WAVES)

    @property
    def units(self) -> tuple[str, ...]:
        """Rad."""
        return ("rad",) * len(self.parameters)

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, rad."""
        return np.full(len(self.parameters), self.expected)

    def turns(self, nominal: SerialChain, at: Postures) -> Floats:
        """Φ (N, n, 4n): each joint's four waves in its own row."""
        once, twice = at.q, 2.0 * at.q
        waves = np.stack([np.sin(once), np.cos(once) - 1.0, np.sin(twice), np.cos(twice) - 1.0], axis=-1)
        result = np.zeros((len(at), self.joints, self.joints, len(WAVES)))
        own = np.arange(self.joints)
        result[:, own, own] = waves
        return result.reshape(len(at), self.joints, len(self.parameters))

    def shifts(self, nominal: SerialChain, at: Postures) -> None:
        """None: joints turn, and carry the tool with them."""
