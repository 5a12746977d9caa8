"""Base and tool that tie a robot to an instrument, quickly, and undisturbed by the rows that fit worst.

With G, g, t for the base's rotation transposed, its offset and the tool, G m + g − R t = p for each measured point m,
flange position p and flange rotation R is linear once G need be no rotation: no start, and no local minimum.
Gauss–Newton steps on the rigid problem follow.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.calibration.datums import telling, with_datums
from cellctl.calibration.model import RobotModel
from cellctl.calibration.registration import register_positions, rigid_fit, sphere_centre, turned_tool
from cellctl.calibration.rows import Measured, PoseRows, PositionRows, SocketRows, TouchRows
from cellctl.calibration.task import Task
from cellctl.calibration.unknowns import Group, State
from cellctl.kinematics import Floats, pose

PLACED: frozenset[Group] = frozenset({"base", "tool"})
STEPS = 4
HELD = 1e-9
"""Directions of base and tool whose share of the points' motion is smaller than this are left as they are."""


def placed(task: Task, kept: list[Any]) -> State:
    """The task's robot, registered on the rows `kept` (indices for each block), and its points."""
    models: list[RobotModel] = []
    own = [session.own for session in task.sessions[1:]]
    blocks = [block.pick(which) for block, which in zip(task.rows.blocks, kept, strict=True)]
    for number in range(len(task.sessions)):
        free = (own[number - 1] if number else PLACED) & (task.registered if task.partial else PLACED)
        begin = models[0] if number else task.model
        models.append(_on_instrument(begin, [block for block in blocks if block.session == number], free))
    state = State.of_sessions(models, own, _points(task, models, blocks), np.zeros(len(task.datums)))
    return with_datums(state, blocks) if task.datums else state


def _on_instrument(model: RobotModel, blocks: list[Measured], free: frozenset[Group]) -> RobotModel:
    """`model` with those of base and tool that are `free` where the instrument's rows want them."""
    measured = [block for block in blocks if isinstance(block, PositionRows | PoseRows) and len(block)]
    if not measured or not free:
        return model
    q, xyz = np.concatenate([block.q for block in measured]), np.concatenate([block.xyz for block in measured])
    chain = model.chain
    if free == PLACED:
        base, tool = base_and_tool(chain.with_base(np.eye(4)).forward_flange(q), xyz, chain.tool_now)
        chain = chain.with_base(base).with_tool(tool)
    else:
        chain = register_positions(chain, q, xyz, base="base" in free, tool="tool" in free)
    turned = [block for block in measured if isinstance(block, PoseRows)]
    if "tool" in free and turned:
        turns = np.concatenate([block.poses[:, :3, :3] for block in turned])
        chain = turned_tool(chain, np.concatenate([block.q for block in turned]), turns)
    return RobotModel(chain, model.effects, model.amounts)


def base_and_tool(flange: Floats, measured: Floats, taught: Floats) -> tuple[Floats, Floats]:
    """Base (4, 4) and tool (4, 4) that carry flange poses (N, 4, 4) nearest to `measured` (N, 3), mm; the tool keeps
    the orientation of `taught` (4, 4).
    """
    tool = _relaxed_tool(flange, measured)
    base, best = np.eye(4), np.inf
    for offset in (tool, taught[:3, 3]):  # the taught tool: where orientation hardly changes, the relaxed one is loose
        tried, found = _refined(flange, measured, offset)
        error = float(np.sum((_tips(flange, tried, found) - measured) ** 2))
        if error < best:
            base, tool, best = tried, found, error
    return base, pose(taught[:3, :3], tool)


def _relaxed_tool(flange: Floats, measured: Floats) -> Floats:
    """The tool (3,) of the linear problem in which the base may be any affine map."""
    middle = measured - measured.mean(axis=0)
    size = max(float(np.abs(middle).max()), 1e-9)
    lines = np.zeros((len(flange), 3, 15))
    for axis in range(3):
        lines[:, axis, 3 * axis : 3 * axis + 3] = middle / size
        lines[:, axis, 9 + axis] = 1.0
    lines[:, :, 12:] = -flange[:, :3, :3]
    flat = lines.reshape(-1, 15)
    return np.asarray(np.linalg.lstsq(flat.T @ flat, flat.T @ flange[:, :3, 3].ravel(), rcond=1e-10)[0][12:])


def _refined(flange: Floats, measured: Floats, tool: Floats) -> tuple[Floats, Floats]:
    """Gauss–Newton from the rigid base that goes with `tool` (3,)."""
    base = rigid_fit(flange[:, :3, :3] @ tool + flange[:, :3, 3], measured)
    for _ in range(STEPS):
        there = _tips(flange, base, tool)
        arms = there - base[:3, 3]
        size = max(float(np.abs(arms).max()), 1e-9)
        lines = np.zeros((len(flange), 3, 9))
        lines[:, :, :3] = np.cross(np.eye(3), arms[:, None, :]).swapaxes(1, 2) / size
        lines[:, :, 3:6] = np.eye(3)
        lines[:, :, 6:] = base[:3, :3] @ flange[:, :3, :3]
        flat = lines.reshape(-1, 9)
        step = np.linalg.lstsq(flat.T @ flat, flat.T @ (measured - there).ravel(), rcond=HELD)[0]
        turn = Rotation.from_rotvec(step[:3] / size).as_matrix()
        base = pose(turn @ base[:3, :3], base[:3, 3] + step[3:6])
        tool = tool + step[6:]
    return base, tool


def _tips(flange: Floats, base: Floats, tool: Floats) -> Floats:
    return np.asarray((flange[:, :3, :3] @ tool + flange[:, :3, 3]) @ base[:3, :3].T + base[:3, 3])


def _points(task: Task, models: list[RobotModel], blocks: list[Measured]) -> Floats:
    """Spheres and sockets (S, 3), mm, where the first block that saw each wants it."""
    points = np.zeros((len(task.points), 3))
    for index in range(len(task.points)):
        for block in blocks:
            if isinstance(block, TouchRows | SocketRows) and np.any(mine := telling(block, index)):
                tips = models[block.session].tip(block.postures.pick(mine))
                points[index] = tips.mean(axis=0)
                if isinstance(block, TouchRows):
                    points[index] = _centre(tips, block.reach[mine])
                break
    return points


def _centre(tips: Floats, reach: Floats) -> Floats:
    """Sphere centre (3,) by Gauss–Newton on the distances, from the linear one."""
    centre = sphere_centre(tips, reach)
    for _ in range(STEPS):
        away = tips - centre
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        step = np.linalg.lstsq(-away / distance[:, None], reach - distance, rcond=1e-6)[0]
        centre = centre + step
    return np.asarray(centre)
