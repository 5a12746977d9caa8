"""Changes of the joints' signs and offsets, and their wording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.kinematics import Floats
from cellctl.setup_check.hypothesis import Change, Hypothesis, Setup

LEAST_OFFSET_DEG = 2.0
"""A smaller error of a zero is a mastering error: for the identification, not for the robot file."""

RIGHT_ANGLE_DEG = 1.0
"""An offset this near to a multiple of 90° is rounded to it."""


@final
@dataclass(frozen=True, eq=False)
class JointChanges:
    """Reversed joints (n,), as −1, and offsets (n,), deg, to be added to those of the robot file."""

    sign: Floats
    offset: Floats

    @classmethod
    def of(cls, n: int, joints: Sequence[int], ways: Sequence[tuple[float, float]]) -> Self:
        """`joints` with a sign and an offset each, the others unchanged."""
        sign, offset = np.ones(n), np.zeros(n)
        for joint, (way, angle) in zip(joints, ways, strict=True):
            sign[joint], offset[joint] = way, angle
        return cls(sign, offset)

    def applied(self, setup: Setup) -> Setup:
        """The set-up with these changes."""
        return setup.with_joints(setup.joints.sign * self.sign, setup.joints.offset + self.offset)

    def and_with(self, joint: int, sign: float, offset: float) -> Self:
        """These changes, and a sign and an offset for one more joint."""
        signs, offsets = self.sign.copy(), self.offset.copy()
        signs[joint], offsets[joint] = sign, offset
        return replace(self, sign=signs, offset=offsets)

    def with_offset(self, joint: int, offset: float) -> Self:
        """These changes with another offset, deg, of one joint; exactly a multiple of 90° where it is near one."""
        right = 90.0 * round(offset / 90.0)
        offset = right if abs(offset - right) < RIGHT_ANGLE_DEG else offset
        return self.and_with(joint, float(self.sign[joint]), _half_turn(offset))

    @property
    def complexity(self) -> int:
        """Few joints before many; reversed joints before right angles before other angles."""
        angles = [offset for offset in self.offset.tolist() if offset]
        both = np.count_nonzero((self.sign < 0.0) & (self.offset != 0.0))
        return 10 * len(self.changed()) + sum(1 if angle % 90.0 == 0.0 else 3 for angle in angles) + int(both)

    @property
    def mastering(self) -> bool:
        """Whether these are small offsets of joint zeros only."""
        return bool(np.all(self.sign > 0.0) and np.all(np.abs(self.offset) < LEAST_OFFSET_DEG))

    def changed(self) -> Any:
        """Which joints are changed."""
        return np.flatnonzero((self.sign < 0.0) | (self.offset != 0.0))

    def hypothesis(self, setup: Setup) -> Hypothesis:
        """These changes, in words and applied to `setup`."""
        changes = tuple(self._change(setup, int(joint)) for joint in self.changed())
        return Hypothesis(changes, self.applied(setup), self.complexity, self.mastering)

    def _change(self, setup: Setup, joint: int) -> Change:
        offset, number = float(self.offset[joint]), joint + 1
        words, cures = [], []
        if self.sign[joint] < 0.0:
            words.append("reversed")
            cures.append(f"sign: {-int(setup.joints.sign[joint])}")
        if offset:
            words.append(f"off by {abs(offset):.1f}°")
            cures.append(f"offset: {_half_turn(setup.joints.offset[joint] + offset):.1f}".removesuffix(".0"))
        key = "sign" if self.sign[joint] < 0.0 else "offset"
        cure = f"{' and '.join(cures)} for joint {number}"
        return Change(f"A{number} {' and '.join(words)}", "robot", cure, ("joints", joint, key))


def _half_turn(angle: float) -> float:
    """The angle, deg, from −180 up to 180."""
    return float((angle + 180.0) % 360.0 - 180.0)
