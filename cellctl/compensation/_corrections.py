"""One pass of each compensation method, and the robot's predicted behaviour that it corrects.

T_d is the target, f the controller's nominal kinematics, f* the identified robot, f₂ the identified robot without its
errors of joint zeros Δθ: f₂(q) = f*(q − Δθ). Veitschegger–Wu and Newton–Raphson work with f₂ and subtract Δθ at the
end. With Δθ in the model too it would count twice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self, TypeAlias, final

import numpy as np

from cellctl.calibration import At, Postures, RobotModel
from cellctl.error_maps import ErrorMap
from cellctl.kinematics import Bools, Floats, SerialChain, inverse, inverse_pose, pose_difference

LEVER_MM = 10.0
"""Distance from the TCP at which a difference in orientation counts as one in position."""

_PASSES = 12
_DONE = 1e-10
_NEGLIGIBLE = 1e-5
"""Combinations of parameters whose effect is this share of the strongest one's stay as they are."""

_FRAMES = ("base_", "tool_")


def with_geometry(controller: SerialChain, identified: RobotModel, postures: At) -> SerialChain:
    """The controller's chain with other links, base and tool, as a UR or a planner takes them.

    It is nearest to the identified robot over `postures`, M of them with their conditions, or model angles (M, n), rad,
    by least squares; orientation counts by `LEVER_MM`. Without effects these are the identified parameters. With
    effects (compliance, harmonics, …) they take over what they can of these.

    What is left then counts as noise, and each parameter's change from the identified one has a prior of 1 mm (1 σ), at
    the reach for an angle. So parameters that `postures` hardly determine (near-parallel axes) keep their size.
    """
    known = identified.chain.deviations
    every = np.ones(len(controller.parameters), bool)
    return _nearest(controller, identified, postures, every, known, prior_mm=1.0)


def with_zeros_and_frames(controller: SerialChain, identified: RobotModel, postures: At) -> SerialChain:
    """The controller's chain with other joint zeros, base and tool, as a KUKA takes them; its links stay.

    As `with_geometry`, without prior. θ1 and θn stay 0: the base's heading and the tool's turn about the last axis hold
    them. The values differ from the identified θ, base and tool, which compensate for links.
    """
    inner = tuple(f"theta{joint}" for joint in range(2, controller.n))
    free = np.array([name in inner or name.startswith(_FRAMES) for name in controller.parameters])
    return _nearest(controller, identified, postures, free, controller.deviations)


def with_frames(controller: SerialChain, identified: RobotModel, postures: At) -> SerialChain:
    """The controller's chain with other base and tool: nominal registered. As `with_zeros_and_frames`."""
    free = np.array([name.startswith(_FRAMES) for name in controller.parameters])
    return _nearest(controller, identified, postures, free, controller.deviations)


def zeros_of(chain: SerialChain) -> Floats:
    """Deviations of the joint zeros θ1 … θn (n,), rad, along the model angles."""
    values = dict(zip(chain.parameters, chain.deviations.tolist(), strict=False))
    return np.array([values.get(f"theta{joint}", 0.0) for joint in range(1, chain.n + 1)])


def _nearest(
    controller: SerialChain,
    identified: RobotModel,
    postures: At,
    free: Bools,
    start: Floats,
    prior_mm: float = np.inf,
) -> SerialChain:
    """The chain whose `free` parameters (P,) bring it nearest to the identified robot, by Gauss–Newton from `start`."""
    q, goal = Postures.of(postures).q, identified.pose(postures)
    unit = np.where(controller.parameter_turns, 1.0 / max(controller.reach_mm, 1.0), 1.0)[free]
    begin = start if start.size else np.zeros(len(free))
    values = begin.copy()
    for _ in range(_PASSES):
        chain = controller.with_parameters(values)
        columns = chain.parameter_jacobian(q)[:, :, free] * unit
        columns[:, 3:] *= LEVER_MM
        left = pose_difference(goal, chain.forward(q))
        left[:, 3:] *= LEVER_MM
        hold = float(np.sqrt(np.mean(left[:, :3] ** 2))) / prior_mm  # σ of the rows / σ of the prior, both mm
        rows = np.concatenate([columns.reshape(-1, len(unit)), hold * np.eye(len(unit))])
        wanted = np.concatenate([left.ravel(), hold * ((begin - values)[free] / unit)])
        step = np.linalg.lstsq(rows, wanted, rcond=_NEGLIGIBLE)[0]
        values[free] += unit * step
        if np.abs(step).max() < _DONE:
            break
    return controller.with_parameters(values)


PredictedErrors: TypeAlias = Callable[[Floats], Floats]
"""Errors of the TCP (N, 3), mm, actual − nominal, at model angles (N, n), rad: an error map's `errors`."""


@final
@dataclass(frozen=True, eq=False)
class MappedErrors:
    """`PredictedErrors` of an error map, with its own σ where it states one: the model's is not theirs."""

    of: ErrorMap

    def __call__(self, q: Floats) -> Floats:
        """The map's errors (N, 3), mm."""
        return self.of.errors(q)

    def sigma(self, q: Floats) -> Floats | None:
        """1 σ (N,), 3-D, mm; None: the map states none."""
        stated = getattr(self.of, "sigma", None)
        return np.asarray(np.linalg.norm(stated(q), axis=-1)) if callable(stated) else None


class Predictor(Protocol):
    """A robot, as the corrections need it."""

    @property
    def zeros(self) -> Floats:
        """Subtracted from the joints (n,), rad, to command them."""

    def pose(self, q: Floats) -> Floats:
        """TCP (N, 4, 4), mm, at joints q (N, n), rad."""

    def jacobian(self, q: Floats) -> Floats:
        """Of the TCP by the joints (N, 6, n), mm and rad per rad."""


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


@final
@dataclass(frozen=True, eq=False)
class NominalWithErrors:
    """f(q) + ê(q): the nominal robot, its TCP shifted by predicted errors; they do not turn it."""

    nominal: SerialChain
    errors: PredictedErrors

    @property
    def zeros(self) -> Floats:
        """None are known: 0 (n,)."""
        return np.zeros(self.nominal.n)

    def pose(self, q: Floats) -> Floats:
        """TCP (N, 4, 4), mm, at joints q (N, n), rad."""
        poses = self.nominal.forward(q)
        poses[:, :3, 3] += self.errors(q)
        return poses

    def jacobian(self, q: Floats) -> Floats:
        """Of the nominal TCP by the joints (N, 6, n), mm and rad per rad."""
        return self.nominal.tool_jacobian(q)


@final
@dataclass(frozen=True, eq=False)
class Pass:
    """Joints (N, n), rad, the pseudo-targets (N, 4, 4) that they belong to, and which the controller reaches (N,)."""

    q: Floats
    pseudo: Floats
    reached: Bools

    def pick(self, rows: Any) -> Self:
        """Those of some rows."""
        return replace(self, q=self.q[rows], pseudo=self.pseudo[rows], reached=self.reached[rows])


Correction = Callable[[SerialChain, Predictor, Floats, Pass], Pass]
"""From the controller's chain, the robot, the targets (N, 4, 4) and a pass: the next one."""

WriteBack = Callable[[SerialChain, RobotModel, At], SerialChain]
"""From the controller's chain, the identified robot and M postures of the region: the chain to write."""


@final
@dataclass(frozen=True, slots=True)
class Method:
    """zeros_apart: the errors of joint zeros are left out of the model and subtracted from the joints at the end.
    position_only: the orientation is the nominal robot's; its error is not compensated. write_back: the parameters that
    the controller takes; such a method has one pass, and what it leaves is the rest of the model.
    """

    correction: Correction
    zeros_apart: bool = False
    position_only: bool = False
    write_back: WriteBack | None = None


def differential(controller: SerialChain, robot: Predictor, targets: Floats, now: Pass) -> Pass:
    """T_s ← T_s + (T_d − f*(f⁻¹(T_s))) as a shift and a small rotation vector along the measuring frame's axes."""
    return _sent(controller, _moved(now.pseudo, pose_difference(targets, robot.pose(now.q))), now)


def matrix_form(controller: SerialChain, robot: Predictor, targets: Floats, now: Pass) -> Pass:
    """T_s ← T_d · (f*(f⁻¹(T_s)))⁻¹ · T_s."""
    return _sent(controller, targets @ inverse_pose(robot.pose(now.q)) @ now.pseudo, now)


def newton_raphson(_: SerialChain, robot: Predictor, targets: Floats, now: Pass) -> Pass:
    """q ← q + δq with J δq = T_d − f₂(q) by least squares; the controller's inverse is not needed again."""
    rest = pose_difference(targets, robot.pose(now.q))
    return replace(now, q=now.q + np.einsum("nij,nj->ni", np.linalg.pinv(robot.jacobian(now.q)), rest))


def cyclic_search(controller: SerialChain, robot: Predictor, targets: Floats, now: Pass) -> Pass:
    """P_step ← P_step + (P_target − P), P the predicted position; Q ← f⁻¹(P_step), the orientation held.

    Meng et al. 2024, doi 10.3390/app142411682, section 3.3. Read literally, the paper's loop subtracts the same step
    twice and never moves; this is what its figure 12 means.
    """
    step = now.pseudo.copy()
    step[:, :3, 3] += targets[:, :3, 3] - robot.pose(now.q)[:, :3, 3]
    return _sent(controller, step, now)


def written(controller: SerialChain, _: Predictor, targets: Floats, now: Pass) -> Pass:
    """Q ← f_w⁻¹(T_d), f_w the kinematics of the controller with the written parameters."""
    return _sent(controller, targets, now)


METHODS = {
    "pseudo-target": Method(differential),
    "pseudo-target-matrix": Method(matrix_form),
    "veitschegger-wu": Method(differential, zeros_apart=True),
    "newton-raphson": Method(newton_raphson, zeros_apart=True),
    "cyclic-search": Method(cyclic_search, position_only=True),
    "write-back-geometry": Method(written, write_back=with_geometry),
    "write-back-zeros": Method(written, write_back=with_zeros_and_frames),
}
"""Veitschegger and Wu 1986, and Newton–Raphson (Gao et al.) are published with one pass."""


def _sent(controller: SerialChain, pseudo: Floats, now: Pass) -> Pass:
    """The controller's joints for pseudo-targets."""
    found = inverse(controller, pseudo, now.q)
    return Pass(found.q, pseudo, found.converged)


def _moved(poses: Floats, by: Floats) -> Floats:
    """`poses` (N, 4, 4) shifted and turned by (N, 6): the position shifts, the turn is about the position."""
    from scipy.spatial.transform import Rotation  # at first use: it takes 0.2 s

    result = poses.copy()
    result[:, :3, 3] += by[:, :3]
    result[:, :3, :3] = np.matmul(Rotation.from_rotvec(by[:, 3:]).as_matrix(), poses[:, :3, :3])
    return result
