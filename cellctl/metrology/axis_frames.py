"""Base and tool frame of a robot by turning A1, A2, A5 and A6 alone (KRG section 2.3), with their covariances.

{B}: z on A1's axis, x along the common perpendicular of A1 and A2, origin on A1. {T}: x on A6's axis, z perpendicular
to A5 and A6, origin at the reflector. Both are geometric statements about the true robot; set against the nominal
chain's own axes they tell where the instrument is and where the reflector is on the flange.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats, SerialChain, inverse_pose, pose, pose_difference
from cellctl.metrology.circles import Circle, fit_circle
from cellctl.metrology.measured_pose import MeasuredPose
from cellctl.metrology.points import Points

LEAST_DISTANCE_MM = 1.0
"""Distance of A1 and A2 above which {B}'s x points from A1 to A2; below, it is the direction z1 × z2."""

_STEPS = np.array([*[1e-3] * 3, *[1e-6] * 3])
"""Steps of central differences by a place (mm) and by a direction."""


class ParallelAxes(ValueError):
    """Two axes have no common perpendicular direction; the text says which and what to do."""


class Line(NamedTuple):
    """A joint's axis: a point on it (3,), mm, and its unit direction (3,)."""

    point: Floats
    direction: Floats


@final
@dataclass(frozen=True, eq=False)
class Turn:
    """One joint turned alone. points: N of the reflector; angles (N,), rad: the joint's model angle at each."""

    points: Points
    angles: Floats


@final
@dataclass(frozen=True, eq=False)
class AxisFrames:
    """What the circles give, in the instrument's frame. base: {B}; tool: {T}; circles: of A1, A2, A5, A6.

    reflector_in_wrist (3,), mm, with covariance (3, 3): the reflector from the point of A6 nearest to A5, along {T}'s
    axes. It does not depend on where the instrument is.
    """

    base: MeasuredPose
    tool: MeasuredPose
    circles: tuple[Circle, Circle, Circle, Circle]
    reflector_in_wrist: Floats
    reflector_covariance: Floats


def axis_frames(a1: Turn, a2: Turn, a5: Turn, a6: Turn, reflector: Points) -> AxisFrames:
    """{B} and {T} from the four turns, each begun from one and the same posture, where `reflector` (one point) is.

    The common part of the instrument's error is carried through all circles together. Raises NoCircle, ParallelAxes.
    """
    turns = (a1, a2, a5, a6)
    circles = tuple(fit_circle(turn.points, turn.angles) for turn in turns)
    covariance = _covariance(circles, Points.joined([*(turn.points for turn in turns), reflector]))
    values = np.concatenate([*(np.append(one.centre, one.direction) for one in circles), reflector.xyz[0]])
    base, tool, place = _frames(values)
    change = _central_differences(lambda moved: _differences(_frames(moved), (base, tool, place)), values)
    spread = change @ covariance @ change.T
    return AxisFrames(
        MeasuredPose(base, spread[:6, :6]),
        MeasuredPose(tool, spread[6:12, 6:12]),
        (circles[0], circles[1], circles[2], circles[3]),
        place,
        spread[12:, 12:],
    )


def base_frame(a1: Line, a2: Line) -> Floats:
    """{B} (4, 4) in the frame of the lines. Raises ParallelAxes."""
    across = _perpendicular(a1, a2, "A1 and A2")
    foot, other = _nearest(a1, a2), _nearest(a2, a1)
    if (other - foot) @ across < -LEAST_DISTANCE_MM:
        across = -across
    return pose(np.column_stack([across, np.cross(a1.direction, across), a1.direction]), foot)


def wrist_frame(a5: Line, a6: Line) -> Floats:
    """Frame (4, 4): x on A6's axis, z along z5 × z6, origin at A6's point nearest to A5. Raises ParallelAxes."""
    up = _perpendicular(a5, a6, "A5 and A6")
    x = a6.direction
    return pose(np.column_stack([x, np.cross(up, x), up]), _nearest(a6, a5))


def axes_of(chain: SerialChain, q: ArrayLike) -> list[Line]:
    """The joints' axes in the robot's base frame at model angles q (n,), rad."""
    frames = chain.with_base(np.eye(4)).frames(q)
    return [Line(frame[:3, 3], frame[:3, 2]) for frame in frames[:-1]]


def station(frames: AxisFrames, chain: SerialChain, q: ArrayLike) -> MeasuredPose:
    """The instrument in the robot's base frame: nominal {B} · measured {B}⁻¹.

    q (n,), rad: the posture from which the turns were begun. The covariance contains the measurement alone: errors of
    nominal A1 and A2 against each other come on top.
    """
    lines = axes_of(chain, q)
    return frames.base.inverse().within(base_frame(lines[0], lines[1]))


def reflector_on_flange(frames: AxisFrames, chain: SerialChain, q: ArrayLike) -> tuple[Floats, Floats]:
    """The reflector's centre (3,), mm, in the nominal flange frame, and its covariance (3, 3)."""
    lines, flange = axes_of(chain, q), chain.with_base(np.eye(4)).forward_flange(q)
    wrist = inverse_pose(flange) @ wrist_frame(lines[-2], lines[-1])
    turn = wrist[:3, :3]
    return wrist[:3, 3] + turn @ frames.reflector_in_wrist, turn @ frames.reflector_covariance @ turn.T


def _covariance(circles: tuple[Circle, ...], points: Points) -> Floats:
    """Of centre and direction of each circle, and the reflector (27, 27)."""
    sizes = [circle.gain.shape[1] for circle in circles]
    gain = np.zeros((6 * len(circles) + 3, sum(sizes) + 3))
    column = 0
    for index, circle in enumerate(circles):
        gain[6 * index : 6 * index + 6, column : column + sizes[index]] = circle.gain[:6]
        column += sizes[index]
    gain[-3:, -3:] = np.eye(3)
    return np.asarray(gain @ points.together() @ gain.T)


def _frames(values: Floats) -> tuple[Floats, Floats, Floats]:
    a1, a2, a5, a6 = (Line(part[:3], part[3:] / np.linalg.norm(part[3:])) for part in values[:24].reshape(4, 6))
    wrist, reflector = wrist_frame(a5, a6), values[24:]
    return base_frame(a1, a2), pose(wrist[:3, :3], reflector), wrist[:3, :3].T @ (reflector - wrist[:3, 3])


def _differences(moved: tuple[Floats, Floats, Floats], at: tuple[Floats, Floats, Floats]) -> Floats:
    slides = [pose_difference(moved[index], at[index]) for index in (0, 1)]
    return np.concatenate([*slides, moved[2] - at[2]])


def _central_differences(function: Callable[[Floats], Floats], at: Floats) -> Floats:
    steps = np.append(np.tile(_STEPS, len(at) // 6), [_STEPS[0]] * (len(at) % 6))
    columns = [function(at + d) - function(at - d) for d in np.diag(steps)]
    return np.stack(columns, axis=1) / (2.0 * steps)


def _perpendicular(one: Line, other: Line, names: str) -> Floats:
    across = np.cross(one.direction, other.direction)
    length = float(np.linalg.norm(across))
    if length < 0.05:
        raise ParallelAxes(f"the axes of {names} are parallel within 3°: turn the robot to another posture")
    return np.asarray(across / length)


def _nearest(one: Line, other: Line) -> Floats:
    """The point of line `one` nearest to line `other`."""
    between, u, v = other.point - one.point, one.direction, other.direction
    cosine = u @ v
    return np.asarray(one.point + u * ((between @ u - cosine * (between @ v)) / (1.0 - cosine**2)))
