"""Touches on one sphere in groups: all touches of a group have the same tool orientation.

Each group locates the sphere's centre in the flange frame, as one point of the four-point method does. Groups whose
touches cannot all be reached are replaced by the next quasi-random orientation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.kinematics import Floats, JointMap, SerialChain
from cellctl.kinematics.low_discrepancy import sobol
from cellctl.planning.touches import (
    Candidate,
    OutOfReach,
    PlannedTouch,
    RobotPostures,
    SphereTarget,
    TouchOptions,
    feasible,
    frames_along,
    linked,
    on_sphere,
    ordered,
    solved,
    spheres_of,
    tool_rotations,
)
from cellctl.planning.ways import Body, Obstacles, Plate, Reach, Ways

_ORIENTATIONS, _NORMALS = 64, 128
"""Quasi-random orientations that are tried for a whole plan, and contact normals for each of them."""

_SHAFT_FROM_UP_DEG = 75.0
"""Largest angle of the tool's shaft from straight up."""


@final
@dataclass(frozen=True, slots=True)
class OrientedTouch:
    """A planned touch and the number of its tool orientation, from 0."""

    orientation: int
    touch: PlannedTouch


def plan_oriented_touches(
    chain: SerialChain,
    joints: JointMap,
    reach: Reach,
    postures: RobotPostures,
    spheres: list[SphereTarget],
    touched: int,
    orientations: int,
    touches: int,
    seed: int,
    options: TouchOptions | None = None,
    *,
    plate: Plate | None = None,
) -> list[OrientedTouch]:
    """Plan `touches` touches on `spheres[touched]` with each of `orientations` tool orientations.

    The order and the paths are as in `plan_touches`, home at both ends; the tool stays clear of all `spheres`. The same
    seed gives the same touches. Raises OutOfReach if too few orientations are reachable.
    """
    options = options or TouchOptions()
    around = spheres_of(spheres)
    body = Body(chain, joints, options.thickness)
    ways = Ways(body, reach, Obstacles(around, plate or Plate.assumed(around)), options.clearance)
    sampler = sobol(4, rng=np.random.default_rng([seed, touched]))
    groups: list[list[Candidate]] = []
    for sample in sampler.random(_ORIENTATIONS):
        group = _group(chain, joints, ways, postures, spheres[touched], touched, touches, sample, options)
        groups += [group] if len(group) == touches else []
        if len(groups) == orientations:
            return _toured(groups, ways, np.array(postures.home))
    raise OutOfReach(
        f"only {len(groups)} of {orientations} tool orientations reach {touches} touches each on sphere "
        f"{spheres[touched].name} within the joint limits and clear of spheres, stems and plate"
    )


def _group(
    chain: SerialChain,
    joints: JointMap,
    ways: Ways,
    postures: RobotPostures,
    sphere: SphereTarget,
    touched: int,
    touches: int,
    sample: Floats,
    options: TouchOptions,
) -> list[Candidate]:
    """Up to `touches` reachable touches with the tool orientation of the quasi-random `sample` (4,)."""
    height, heading, spin, choice = sample[:, None]
    away = on_sphere(1.0 - height * (1.0 - np.cos(np.radians(_SHAFT_FROM_UP_DEG))), heading)
    rotation = tool_rotations(chain, away, spin)
    normals = _normals(away[0], options)
    readings = solved(
        chain,
        joints,
        ways,
        postures,
        sphere,
        normals,
        np.broadcast_to(rotation, (len(normals), 3, 3)),
        np.broadcast_to(choice, len(normals)),
        options,
    )
    home = np.array(postures.home)
    found: list[Candidate] = []
    for each in readings:
        candidate = feasible(ways, sphere.name, touched, each, home, options)
        found += [candidate] if candidate else []
        if len(found) == touches:
            break
    return found


def _normals(away: Floats, options: TouchOptions) -> Floats:
    """Contact normals (k, 3) within the tilt of the shaft's direction `away` (3,), not lower than the cap."""
    height, heading = sobol(2, rng=np.random.default_rng(0)).random(_NORMALS).T
    about = on_sphere(1.0 - height * (1.0 - np.cos(np.radians(options.tilt))), heading)
    normals = about @ frames_along(away[None])[0].T
    return np.asarray(normals[normals[:, 2] >= np.cos(np.radians(options.cap))])


def _toured(groups: list[list[Candidate]], ways: Ways, home: Floats) -> list[OrientedTouch]:
    orientation = {id(candidate): number for number, group in enumerate(groups) for candidate in group}
    tour = ordered([candidate for group in groups for candidate in group], ways, home)
    return [
        OrientedTouch(orientation[id(candidate)], touch)
        for candidate, touch in zip(tour, linked(tour, ways, home), strict=True)
    ]
