"""Sphere, plane, point or distance: which constraint identifies a robot best, at equal numbers of touches.

The spherical-constraint paper (doi 10.3390/app14219824) says that touches on a sphere give better accuracy than plane,
point or distance constraints. KR5 robots drawn from the prior (the tests' own arm) are measured in each way, 0.03 mm
1 σ, at places unknown to the fit, the wrist turned at random in the same way everywhere, the tool from outside.
Volumetric: 3-D RMS over the workspace of `simulated_data`, the best rigid motion removed; mean over the robots with its
95 % interval.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cellctl.calibration import (
    Measured,
    PlaneRows,
    RowBlocks,
    SocketRows,
    SpacingRows,
    Task,
    TouchRows,
    identify,
    sigma_among,
)
from cellctl.formats import RobotFile
from tests.helpers.arms import KR5_FILE
from tests.helpers.own_campaigns import Campaign, body_error, certificate, nominal_of
from tests.helpers.own_model import Floats
from tests.helpers.simulated_data import HIGH, LOW, workspace_of
from tests.studies._runner import Row, Study, Table, each

SIGMA_MM = 0.03
BY_HAND_MM = 0.1
CERTIFIED_MM = 0.01
BAR_MM = 500.0
POSTURES = 256
ONE = np.array([[1000.0, 0.0, 250.0]])
THREE = np.array([[950.0, -350.0, 250.0], [950.0, 350.0, 250.0], [1150.0, 0.0, 400.0]])
ANCHORS = np.array([[1000.0, 0.0, 100.0], [900.0, -450.0, 150.0], [900.0, 450.0, 150.0]])
PLANES = np.array(
    [[1000.0, 0.0, 200.0, 0.0, 0.0, 1.0], [1300.0, 0.0, 450.0, -1.0, 0.0, 0.0], [950.0, -450.0, 450.0, 0.0, 1.0, 0.0]]
)
PAIRS = [(0, 1), (0, 2), (1, 2)]

TRIED = 5
"""Rows drawn for each that is kept: the others' tools would go through what they touch."""

AT_PLACES = TouchRows | PlaneRows | SocketRows
AtPoints = TypeVar("AtPoints", TouchRows, SocketRows)
Rows = Callable[[Campaign, int, Floats], Measured | list[Measured]]


def spheres(campaign: Campaign, count: int, places: Floats) -> Measured:
    """Touches on spheres of 31 mm radius, from any side on which the flange is too."""
    block = campaign.touches(TRIED * count, places, SIGMA_MM)
    return _towards_flange(campaign, block, campaign.truth.points(block.q) - places[block.point], count)


def planes(campaign: Campaign, count: int, places: Floats) -> Measured:
    """Touches within 300 mm of a point of each plane, the flange on its side."""
    return campaign.planes(count, places, SIGMA_MM)


def sockets(campaign: Campaign, count: int, places: Floats, sigma: float = SIGMA_MM) -> SocketRows:
    """The tip at each place, held by a socket, the flange above it."""
    block = campaign.sockets(TRIED * count, places, sigma)
    return _towards_flange(campaign, block, np.array([0.0, 0.0, 1.0]), count)


def by_hand(campaign: Campaign, count: int, places: Floats) -> Measured:
    """The tip at each place, as well as somebody can align it by eye."""
    return sockets(campaign, count, places, BY_HAND_MM)


def bars(campaign: Campaign, count: int, places: Floats, sigma: float = SIGMA_MM) -> TouchRows:
    """A rod of one known length from each anchor to the tool, swung about the upper half space."""

    def goals(point: NDArray[np.intp]) -> Floats:
        away = campaign.rng.normal(size=(len(point), 3))
        away[:, 2] = np.abs(away[:, 2])
        return np.asarray(places[point] + BAR_MM * away / np.linalg.norm(away, axis=1, keepdims=True))

    return _measured_from(campaign, count, places, goals, sigma)


def wires(campaign: Campaign, count: int, places: Floats, sigma: float = SIGMA_MM) -> Measured:
    """A draw-wire of known zero from each anchor to the tool, anywhere in the workspace."""

    def goals(point: NDArray[np.intp]) -> Floats:
        return campaign.rng.uniform(LOW, HIGH, (len(point), 3))

    return _measured_from(campaign, count, places, goals, sigma)


def planes_and_rod(campaign: Campaign, count: int, places: Floats) -> list[Measured]:
    """Planes, and a rod for a fifth of the touches."""
    rod = bars(campaign, count // 5, ANCHORS[:1])
    return [planes(campaign, count - count // 5, places), replace(rod, point=rod.point + len(places))]


def _towards_flange(campaign: Campaign, block: AtPoints, normals: Floats, count: int) -> AtPoints:
    """The first `count` rows whose flange is on the side of `normals` (N, 3) or (3,) of the tip."""
    arms = campaign.truth.flange(block.q)[:, :3, 3] - campaign.truth.points(block.q)
    possible = np.flatnonzero(np.sum(arms * normals, axis=1) > 0.0)
    assert len(possible) >= count
    return block.pick(possible[:count])


def _measured_from(
    campaign: Campaign, count: int, places: Floats, goals: Callable[[NDArray[np.intp]], Floats], sigma: float
) -> TouchRows:
    point = np.arange(count) % len(places)
    q = campaign.standing(point, goals)
    length = np.linalg.norm(campaign.truth.points(q) - places[point], axis=1)
    reach = length + campaign.rng.normal(0.0, sigma, count)
    return TouchRows(q, point, reach, np.full((count, 1), sigma))


KINDS: Mapping[str, tuple[Rows, Floats, bool]] = {
    "one sphere": (spheres, ONE, False),
    "one plane": (planes, PLANES[:1], False),
    "one point": (sockets, ONE, False),
    "one point, aligned by hand (0.1 mm)": (by_hand, ONE, False),
    "one distance: rod of 500 mm": (bars, ANCHORS[:1], False),
    "one distance: draw-wire": (wires, ANCHORS[:1], False),
    "three spheres": (spheres, THREE, False),
    "three planes": (planes, PLANES, False),
    "three planes, a fifth of the touches by one rod": (planes_and_rod, PLANES, False),
    "three points": (sockets, THREE, False),
    "three points, aligned by hand (0.1 mm)": (by_hand, THREE, False),
    "three distances: rods of 500 mm": (bars, ANCHORS, False),
    "three distances: draw-wires": (wires, ANCHORS, False),
    "three spheres, spacings certified": (spheres, THREE, True),
    "three points, spacings certified": (sockets, THREE, True),
    "three distances: rods, spacings of the anchors certified": (bars, ANCHORS, True),
    "three distances: draw-wires, spacings of the anchors certified": (wires, ANCHORS, True),
}


def measured(rows: Rows, places: Floats, certified: bool, count: int, seed: int, asked: Floats) -> dict[str, float]:
    """Identify the robot of `seed` from `count` rows; judge it at angles `asked` (M, 6), rad.

    Volumetric RMS before and after, and 1 σ of the latter as the fit states it, mm.
    """
    campaign = Campaign.of(seed)
    campaign = replace(campaign, truth=replace(campaign.truth, base=np.eye(4)))
    nominal, blocks = nominal_of(campaign.nominal), RowBlocks.of(rows(campaign, count, places))
    spacing: SpacingRows | None = certificate(campaign.rng, places, PAIRS, CERTIFIED_MM) if certified else None
    points = 1 + max(int(block.point.max()) for block in blocks.blocks if isinstance(block, AT_PLACES))
    names = tuple(f"P{number + 1}" for number in range(points))
    task = Task(nominal, blocks, names, np.full((points, 3), np.nan), spacing)
    found = identify(task).identified
    model, robot, true = found.state.model, found.unknowns.robot, campaign.truth.points(asked)
    return {
        "before": body_error(nominal.tcp(asked), true),
        "after": body_error(model.tcp(asked), true),
        "stated": sigma_among(model, found.covariance[:robot, :robot], asked),
    }


def units(asked: Namespace) -> Iterator[Row]:
    """Every robot by every constraint with every number of touches."""
    return each(constraint=KINDS, touches=asked.touches, seed=asked.seeds)


def measure(constraint: str, touches: int, seed: int) -> Row:
    """The figures of one robot."""
    return measured(*KINDS[constraint], touches, seed, _everywhere())


@cache
def _everywhere() -> Floats:
    robot = RobotFile.load(KR5_FILE)
    return robot.joint_map().model(workspace_of(robot, POSTURES))


def tables(found: list[Row], asked: Namespace) -> Iterator[Table]:
    """A line for each constraint, and the nominal robot."""
    head = " | ".join(f"{count} touches | stated" for count in asked.touches)
    lines = [f"| constraint | numbers per touch | {head} |", "|---|---|" + "---|---|" * len(asked.touches)]
    for name, (rows, _, _) in KINDS.items():
        cells = [name, "3" if rows in (sockets, by_hand) else "1"]
        for count in asked.touches:
            all_of = [row for row in found if (row["constraint"], row["touches"]) == (name, count)]
            stated = np.sqrt(np.mean([row["stated"] ** 2 for row in all_of])) if all_of else np.nan
            cells += [_interval([row["after"] for row in all_of]), f"{stated:.3f}"]
        lines.append("| " + " | ".join(cells) + " |")
    before = {row["seed"]: row["before"] for row in reversed(found)}
    lines.append("| nominal robot | – |" + f" {_interval(list(before.values()))} | – |" * len(asked.touches))
    yield Table("\n".join(lines), "constraint figures")


def _interval(values: list[float]) -> str:
    if len(values) < 2:
        return "–"
    half = 1.96 * float(np.std(values, ddof=1)) / len(values) ** 0.5
    return f"{np.mean(values):.3f} ± {half:.3f}"


TOUCHES = {"--touches": {"type": int, "nargs": "+", "default": [50, 100]}}
STUDY = Study(units, measure, tables, seeds=40, first=0, options=TOUCHES, writes=True)
