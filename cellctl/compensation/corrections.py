"""One pass of each compensation method: from the joints so far to better ones.

T_d is the target, f the controller's nominal kinematics, f* the identified robot, f₂ the identified robot without its
errors of joint zeros Δθ: f₂(q) = f*(q − Δθ). The last two methods work with f₂ and subtract Δθ at the end. With Δθ in
the model too it would count twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, final

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.calibration import RobotModel
from cellctl.kinematics import Bools, Floats, SerialChain, inverse, inverse_pose, rotation_vector


@final
@dataclass(frozen=True, eq=False)
class Pass:
    """Joints (N, n), rad, the pseudo-targets (N, 4, 4) that they belong to, and which the controller reaches (N,)."""

    q: Floats
    pseudo: Floats
    reached: Bools


@final
@dataclass(frozen=True, eq=False)
class WithoutZeros:
    """f₂ of an identified robot: `zeros` (n,), rad, are the errors of joint zeros that are left out of it."""

    identified: RobotModel
    zeros: Floats

    @classmethod
    def of(cls, identified: RobotModel, *, apart: bool) -> Self:
        """apart: θ1 … θn are left out (a joint without that parameter has none); otherwise nothing is."""
        amounts = [identified.amount(f"theta{joint}") or 0.0 for joint in range(1, identified.n + 1)]
        return cls(identified, np.array(amounts) if apart else np.zeros(identified.n))

    def pose(self, q: Floats) -> Floats:
        """TCP (N, 4, 4), mm, at joints q (N, n), rad."""
        return self.identified.pose(q - self.zeros)

    def jacobian(self, q: Floats) -> Floats:
        """Of the TCP by the joints (N, 6, n), mm and rad per rad."""
        return self.identified.chain.tool_jacobian(q - self.zeros)


Correction = Callable[[SerialChain, WithoutZeros, Floats, Pass], Pass]
"""From the controller's chain, the robot, the targets (N, 4, 4) and a pass: the next one."""


@final
@dataclass(frozen=True, slots=True)
class Method:
    """zeros_apart: the errors of joint zeros are left out of the model and subtracted from the joints at the end."""

    correction: Correction
    zeros_apart: bool = False


def differential(controller: SerialChain, robot: WithoutZeros, targets: Floats, now: Pass) -> Pass:
    """T_s ← T_s + (T_d − f*(f⁻¹(T_s))) as a shift and a small rotation vector along the measuring frame's axes."""
    rest = np.where(now.reached[:, None], difference(targets, robot.pose(now.q)), 0.0)
    return _sent(controller, _moved(now.pseudo, rest), now)


def matrix_form(controller: SerialChain, robot: WithoutZeros, targets: Floats, now: Pass) -> Pass:
    """T_s ← T_d · (f*(f⁻¹(T_s)))⁻¹ · T_s."""
    pseudo = targets @ inverse_pose(robot.pose(now.q)) @ now.pseudo
    return _sent(controller, np.where(now.reached[:, None, None], pseudo, now.pseudo), now)


def newton_raphson(controller: SerialChain, robot: WithoutZeros, targets: Floats, now: Pass) -> Pass:
    """q ← q + δq with J δq = T_d − f₂(q) by least squares; the controller's inverse is not needed again."""
    rest = difference(targets, robot.pose(now.q))
    step = np.einsum("nij,nj->ni", np.linalg.pinv(robot.jacobian(now.q)), rest)
    return Pass(now.q + np.where(now.reached[:, None], step, 0.0), now.pseudo, now.reached)


METHODS = {
    "pseudo-target": Method(differential),
    "pseudo-target-matrix": Method(matrix_form),
    "veitschegger-wu": Method(differential, zeros_apart=True),
    "newton-raphson": Method(newton_raphson, zeros_apart=True),
}
"""Veitschegger and Wu 1986, and Newton–Raphson (Gao et al.) are published with one pass."""


def difference(goal: Floats, actual: Floats) -> Floats:
    """Shift (mm) and rotation vector (rad) from actual to goal (N, 6), along the measuring frame's axes."""
    turn = np.matmul(goal[:, :3, :3], np.swapaxes(actual[:, :3, :3], -1, -2))
    return np.concatenate([goal[:, :3, 3] - actual[:, :3, 3], rotation_vector(turn)], axis=-1)


def _sent(controller: SerialChain, pseudo: Floats, now: Pass) -> Pass:
    """The controller's joints for pseudo-targets; those out of reach stay as they were."""
    found = inverse(controller, pseudo, now.q)
    q = np.where(now.reached[:, None], found.q, now.q)
    return Pass(q, pseudo, np.asarray(now.reached & found.converged))


def _moved(poses: Floats, by: Floats) -> Floats:
    """`poses` (N, 4, 4) shifted and turned by (N, 6): the position shifts, the turn is about the position."""
    result = poses.copy()
    result[:, :3, 3] += by[:, :3]
    result[:, :3, :3] = np.matmul(Rotation.from_rotvec(by[:, 3:]).as_matrix(), poses[:, :3, :3])
    return result
