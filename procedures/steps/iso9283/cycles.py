"""The cycles of a test as plans of the step that measures."""

from __future__ import annotations

from itertools import pairwise
from typing import Protocol

import numpy as np

from cellctl.formats import RobotFile, postures_of
from cellctl.formats.cell_sections import reflectors_of
from cellctl.kinematics import Floats
from cellctl.procedure import CellContext
from procedures.steps.iso9283.cube import CYCLE, VARIED, Cube
from procedures.steps.iso9283.plans import CubePose, CubeRound
from procedures.steps.tracker.turn_planning import APPROACH_DEG, return_pose, rounded, turn_posture


class Cycles(Protocol):
    """The procedure's settings."""

    @property
    def cycles(self) -> int:
        """How many."""

    @property
    def directions(self) -> bool:
        """Whether P1, P2, P4 are visited from three directions, too."""

    @property
    def monuments_every(self) -> int:
        """Poses between two visits to the monuments."""


def cube_rounds(context: CellContext, cube: Cube, joints: Floats, wanted: Cycles, *, by_table: bool) -> list[CubeRound]:
    """All cycles at joints (5, n), deg, in rounds of whole cycles; by_table: the joints are of table rows 1 … 5."""
    visits = [
        CubePose(
            number=number,
            kind="cube",
            reflector=reflectors_of(context.cell).on_flange[0].id,
            origin=rounded(joints[place]),
            way=[rounded(begin)],
            joints=rounded(joints[place]),
            direction=np.sign(joints[place] - begin).astype(int).tolist(),
            row=place + 1 if by_table else None,
            cycle=cycle,
            place=place,
            side=side,
        )
        for number, (cycle, place, side, begin) in enumerate(_visits(cube, joints, wanted))
    ]
    each = len(visits) // wanted.cycles
    size = each * max(1, wanted.monuments_every // each)
    return [_round(context, visits[first : first + size], first // size) for first in range(0, len(visits), size)]


def _visits(cube: Cube, joints: Floats, wanted: Cycles) -> list[tuple[int, int, int, Floats]]:
    """Cycle, place, side, and where the approach begins (n,), deg."""
    one = [(place, 0, joints[place] - APPROACH_DEG) for place in CYCLE]
    if wanted.directions:
        one += [(place, side + 1, cube.sides[place, side]) for place in VARIED for side in range(3)]
    return [(cycle, *visit) for cycle in range(wanted.cycles) for visit in one]


def _round(context: CellContext, poses: list[CubePose], number: int) -> CubeRound:
    """The poses one after another; the first one from the return pose, over home."""
    home = rounded(postures_of(context.cell, RobotFile.load(context.robot_file), "turn").home)
    first = poses[0].model_copy(update={"origin": rounded(turn_posture(context)), "way": [home, *poses[0].way]})
    others = [after.model_copy(update={"origin": before.joints}) for before, after in pairwise(poses)]
    back = return_pose(context, poses[-1].joints, number)
    return CubeRound(poses=[first, *others], back=back.model_copy(update={"way": [home, *back.way]}))
