"""The step of an on-line correction as machine code: numba compiles these functions once and keeps them on disk.

**Problem.** f(q) is the TCP's pose by the controller's kinematics at the programmed joints q, f* that of the identified
robot. Sought is the correction δ (6,) with f*(q + δ) = f(q): then the real robot is where the controller believes it
is.

**Identified robot.** With C_0 … C_6 its constant frames, as fitted,

    f*(q) = C_0 Rz(q_1 + t_1) C_1 … Rz(q_6 + t_6) C_6,  its TCP shifted by d,
    t_j = (ĝ × ẑ_j)·(Σ_k (w_kxj x̂_k + w_kyj ŷ_k) + l_j (p_L − o_j)) + Σ_m s_m sin m q_j + c_m (cos m q_j − 1),
    d = b (ĝ − (ĝ·ẑ)ẑ) + Σ_k g_k o_k + Σ_m v_m exp(−½ ‖S_m q − c_m‖²):

turns t by the weight of links and load on the joints' springs and by the waves of their gears; shifts d by bending of
the tool, expansion of the links, and field or discrepancy. x̂, ŷ, ẑ, o are of the frames of the *nominal* robot, as in
the fit (decision 8), so that t and d are closed forms in q. The model's effects fill the factors (`Effect.add_online`).

**Step.** Newton's method with the Jacobian J of f in place of that of f*, which differs by thousandths:

    δ ← δ + Jᵀ (J Jᵀ + λ² I)⁻¹ (f(q) − f*(q + δ)),

once a cycle, from the last cycle's δ. The difference of two poses is a shift, mm, and a small rotation vector, rad
times a lever. A direction with singular value σ moves by σ²/(σ² + λ²) of its error (Wampler 1986; Nakamura and Hanafusa
1986): 1 − 1 % for σ = 100 mm, next to nothing at a singularity, where no step is right. J Jᵀ + λ² I is positive
definite, so elimination needs no pivoting, and the step has the same cost in every cycle.

After 4 ms of other work on the processor, the same step costs 0.15 to 0.3 ms in plain Python or in calls of numpy, and
0.03 ms here (decision 51). Frames are (3, 4) arrays: x, y, z and place, mm; angles are rad.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import NamedTuple, ParamSpec, TypeAlias, TypeVar

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numba
import numpy as np
from numpy.typing import NDArray

from drivers.kuka_rsi import AXES

Floats: TypeAlias = NDArray[np.float64]
_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")

_DAMPING_MM = 10.0
"""λ: a singular direction is left alone. Elsewhere (σ from 100 mm/rad on) one step leaves 1 % more at most, and the
next cycle takes that."""

_LEVER_MM = 500.0
"""A radian of the TCP's orientation counts as so many millimetres in the damping: about the lever of the wrist's motion
at the TCP. Where all six equations can be met it has no influence."""

_MOST_RAD = math.radians(5.0)
"""No calibration error is larger: at a singularity the steps end here, and find back."""


class Chains(NamedTuple):
    """Both robots in the nominal robot's base.

    nominal, true (7, 3, 4): C0 … C6 of C0 Rz(q1) C1 … Rz(q6) C6, up to the flange, and up to the identified TCP;
    tool (3, 4): nominal; shift_turn (3, 3): turns the shifts into this base.
    """

    nominal: Floats
    true: Floats
    tool: Floats
    shift_turn: Floats


class Effects(NamedTuple):
    """down (3,), load (6,), load_place (3,), bend (1,), stretch (7,), weight (6, 2, 6): as `model_arrays` has them.

    waves (6, M): c − is of each joint, from the highest order to 1; node_place, node_scale (N, 6), node_weight (3, N).
    """

    down: Floats
    load: Floats
    load_place: Floats
    bend: Floats
    stretch: Floats
    weight: Floats
    waves: NDArray[np.complex128]
    node_place: Floats
    node_scale: Floats
    node_weight: Floats


def _compiled(function: Callable[_Given, _Result]) -> Callable[_Given, _Result]:
    """`function` as machine code; where no folder can be written to keep it, each process compiles it anew."""
    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:
        return numba.njit(cache=False)(function)


@_compiled
def newton_step(chains: Chains, effects: Effects, q: Floats, last: Floats) -> Floats:
    """δ (6,) from `last`: one step of δ ← δ + J⁺(q)(f(q) − f*(q + δ)) at model angles q (6,)."""
    frames = _frames(chains.nominal, q)
    goal = _product(frames[AXES], chains.tool)
    jacobian = _jacobian(frames, goal)
    rest = _difference(goal, _true_pose(chains, effects, q + last))
    pull = _solved(jacobian, rest)
    found = np.empty(AXES)
    for joint in range(AXES):
        step = 0.0
        for row in range(6):
            step += jacobian[row, joint] * pull[row]
        found[joint] = max(-_MOST_RAD, min(_MOST_RAD, last[joint] + step))
    return found


@_compiled
def _true_pose(chains: Chains, effects: Effects, q: Floats) -> Floats:
    """The identified robot's TCP (3, 4)."""
    frames = _frames(chains.nominal, q)
    end: Floats = _frames(chains.true, q + _turns(effects, q, frames))[AXES]
    shift = _shift(effects, q, frames)
    for i in range(3):
        for k in range(3):
            end[i, 3] += chains.shift_turn[i, k] * shift[k]
    return end


@_compiled
def _turns(effects: Effects, q: Floats, frames: Floats) -> Floats:
    """What the joints (6,) turn by: weight and load on their springs, and the waves of their gears."""
    found = np.empty(AXES)
    load_at = frames[AXES, :, 3].copy()
    for i in range(3):
        for k in range(3):
            load_at[i] += frames[AXES, i, k] * effects.load_place[k]
    for joint in range(AXES):
        arm = _cross(effects.down, frames[joint, :, 2])
        turn = 0.0
        for i in range(3):
            pull = effects.load[joint] * (load_at[i] - frames[joint, i, 3])
            for k in range(AXES):
                pull += effects.weight[k, 0, joint] * frames[k, i, 0] + effects.weight[k, 1, joint] * frames[k, i, 1]
            turn += arm[i] * pull
        found[joint] = turn + _wave(effects.waves[joint], q[joint])
    return found


@_compiled
def _wave(waves: NDArray[np.complex128], angle: float) -> float:
    """Σ s sin mq + c (cos mq − 1): the real part of Σ (c − is)(zᵐ − 1) with z = e^iq, by Horner's rule."""
    z = complex(math.cos(angle), math.sin(angle))
    total, constant = 0j, 0.0
    for each in waves:
        total = (total + each) * z
        constant += each.real
    return total.real - constant


@_compiled
def _shift(effects: Effects, q: Floats, frames: Floats) -> Floats:
    """Shift (3,) of the TCP along the robot's base: bending, expansion, field."""
    found = np.zeros(3)
    along = frames[AXES, :, 2]
    share = 0.0
    for i in range(3):
        share += effects.down[i] * along[i]
    for i in range(3):
        found[i] = effects.bend[0] * (effects.down[i] - share * along[i])
        for k in range(AXES + 1):
            found[i] += effects.stretch[k] * frames[k, i, 3]
    for node in range(effects.node_place.shape[0]):
        square = 0.0
        for k in range(AXES):
            away = q[k] * effects.node_scale[node, k] - effects.node_place[node, k]
            square += away * away
        kernel = math.exp(-0.5 * square)
        for i in range(3):
            found[i] += effects.node_weight[i, node] * kernel
    return found


@_compiled
def _frames(constants: Floats, q: Floats) -> Floats:
    """The frames behind the joints and the end (7, 3, 4), of C0 Rz(q1) C1 … Rz(q6) C6."""
    found = np.empty((AXES + 1, 3, 4))
    here = constants[0].copy()
    for joint in range(AXES):
        cosine, sine = math.cos(q[joint]), math.sin(q[joint])
        for i in range(3):
            x, y = here[i, 0], here[i, 1]
            here[i, 0], here[i, 1] = cosine * x + sine * y, cosine * y - sine * x
        found[joint] = here
        here = _product(here, constants[joint + 1])
    found[AXES] = here
    return found


@_compiled
def _product(a: Floats, b: Floats) -> Floats:
    """The frame b seen from where a is."""
    found = np.empty((3, 4))
    for i in range(3):
        for k in range(4):
            found[i, k] = a[i, 0] * b[0, k] + a[i, 1] * b[1, k] + a[i, 2] * b[2, k]
        found[i, 3] += a[i, 3]
    return found


@_compiled
def _cross(a: Floats, b: Floats) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_compiled
def _difference(goal: Floats, actual: Floats) -> Floats:
    """Shift, mm, and small rotation vector, rad times the lever, from frame `actual` to `goal`: (6,)."""
    found = np.zeros(6)
    for i in range(3):
        found[i] = goal[i, 3] - actual[i, 3]
        turn = _cross(actual[:, i], goal[:, i])
        for k in range(3):
            found[3 + k] += 0.5 * _LEVER_MM * turn[k]
    return found


@_compiled
def _jacobian(frames: Floats, end: Floats) -> Floats:
    """The TCP's motion by each joint: mm, and rad times the lever, per rad (6, 6)."""
    found = np.empty((6, AXES))
    for joint in range(AXES):
        axis = frames[joint, :, 2]
        motion = _cross(axis, end[:, 3] - frames[joint, :, 3])
        for i in range(3):
            found[i, joint], found[3 + i, joint] = motion[i], _LEVER_MM * axis[i]
    return found


@_compiled
def _solved(jacobian: Floats, rest: Floats) -> Floats:
    """y (6,) of (J Jᵀ + λ²) y = rest (6,), by elimination: the matrix is positive definite."""
    matrix, found = np.zeros((6, 6)), rest.copy()
    for i in range(6):
        matrix[i, i] = _DAMPING_MM**2
        for k in range(6):
            for joint in range(AXES):
                matrix[i, k] += jacobian[i, joint] * jacobian[k, joint]
    for i in range(6):
        for row in range(i + 1, 6):
            factor = matrix[row, i] / matrix[i, i]
            for k in range(i, 6):
                matrix[row, k] -= factor * matrix[i, k]
            found[row] -= factor * found[i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            found[i] -= matrix[i, k] * found[k]
        found[i] /= matrix[i, i]
    return found
