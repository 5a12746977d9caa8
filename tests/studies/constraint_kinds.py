"""Sphere, plane, point or distance: which constraint identifies a robot best, at equal numbers of touches.

    uv run python tests/studies/constraint_kinds.py [--seeds 40] [--touches 50 100]
                                                    [--write docs/results/constraints.md]

The spherical-constraint paper (doi 10.3390/app14219824) says that touches on a sphere give better accuracy than plane,
point or distance constraints. KR5 robots drawn from the prior (the tests' own arm) are measured in each way, 0.03 mm
1 σ, at places unknown to the fit, the wrist turned at random in the same way everywhere, the tool from outside.
Volumetric: 3-D RMS over the workspace of `volumetric.py`, the best rigid motion removed; mean over the robots with its
95 % interval.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from kr5_model import ROBOT
from own_arm import Floats
from own_campaigns import Campaign, body_error, certificate, nominal_of
from volumetric import HIGH, LOW, workspace_of

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
BEGIN, END = "<!-- constraint figures -->", "<!-- end of constraint figures -->"

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


KINDS: tuple[tuple[str, Rows, Floats, bool], ...] = (
    ("one sphere", spheres, ONE, False),
    ("one plane", planes, PLANES[:1], False),
    ("one point", sockets, ONE, False),
    ("one point, aligned by hand (0.1 mm)", by_hand, ONE, False),
    ("one distance: rod of 500 mm", bars, ANCHORS[:1], False),
    ("one distance: draw-wire", wires, ANCHORS[:1], False),
    ("three spheres", spheres, THREE, False),
    ("three planes", planes, PLANES, False),
    ("three planes, a fifth of the touches by one rod", planes_and_rod, PLANES, False),
    ("three points", sockets, THREE, False),
    ("three points, aligned by hand (0.1 mm)", by_hand, THREE, False),
    ("three distances: rods of 500 mm", bars, ANCHORS, False),
    ("three distances: draw-wires", wires, ANCHORS, False),
    ("three spheres, spacings certified", spheres, THREE, True),
    ("three points, spacings certified", sockets, THREE, True),
    ("three distances: rods, spacings of the anchors certified", bars, ANCHORS, True),
    ("three distances: draw-wires, spacings of the anchors certified", wires, ANCHORS, True),
)


@dataclass(frozen=True)
class Figures:
    """One robot: volumetric RMS before and after, and 1 σ of the latter as the fit states it, mm."""

    before: float
    after: float
    stated: float


def measured(rows: Rows, places: Floats, certified: bool, count: int, seed: int, asked: Floats) -> Figures:
    """Identify the robot of `seed` from `count` rows; judge it at angles `asked` (M, 6), rad."""
    campaign = Campaign.of(seed)
    campaign = replace(campaign, truth=replace(campaign.truth, base=np.eye(4)))
    nominal, blocks = nominal_of(campaign.nominal), RowBlocks.of(rows(campaign, count, places))
    spacing: SpacingRows | None = certificate(campaign.rng, places, PAIRS, CERTIFIED_MM) if certified else None
    points = 1 + max(int(block.point.max()) for block in blocks.blocks if isinstance(block, AT_PLACES))
    names = tuple(f"P{number + 1}" for number in range(points))
    task = Task(nominal, blocks, names, np.full((points, 3), np.nan), spacing)
    found = identify(task).identified
    model, robot, true = found.state.model, found.unknowns.robot, campaign.truth.points(asked)
    return Figures(
        before=body_error(nominal.tcp(asked), true),
        after=body_error(model.tcp(asked), true),
        stated=sigma_among(model, found.covariance[:robot, :robot], asked),
    )


def study(seeds: int, touches: list[int]) -> list[str]:
    """The table."""
    robot = RobotFile.load(ROBOT)
    asked = robot.joint_map().model(workspace_of(robot, POSTURES))
    lines = [
        "| constraint | numbers per touch | " + " | ".join(f"{count} touches | stated" for count in touches) + " |"
    ]
    lines.append("|---|---|" + "---|---|" * len(touches))
    before = []
    for name, rows, places, certified in KINDS:
        cells = [name, "3" if rows in (sockets, by_hand) else "1"]
        for count in touches:
            all_of = [measured(rows, places, certified, count, seed, asked) for seed in range(seeds)]
            before += [one.before for one in all_of]
            stated = np.sqrt(np.mean([one.stated**2 for one in all_of]))
            cells += [_interval([one.after for one in all_of]), f"{stated:.3f}"]
        lines.append("| " + " | ".join(cells) + " |")
        print(lines[-1], file=sys.stderr, flush=True)
    lines.append("| nominal robot | – |" + f" {_interval(before[:seeds])} | – |" * len(touches))
    return lines


def _interval(values: list[float]) -> str:
    half = 1.96 * float(np.std(values, ddof=1)) / len(values) ** 0.5
    return f"{np.mean(values):.3f} ± {half:.3f}"


def write_into(document: Path, table: str) -> None:
    """Replace the table between the marks."""
    before, begin, rest = document.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise RuntimeError(f"{document} has no place for the figures")
    document.write_text(f"{before}{begin}\n{table}\n{end}{after}", encoding="utf-8")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Sphere, plane, point and distance at equal numbers of touches.")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--touches", type=int, nargs="+", default=[50, 100])
    parser.add_argument("--write", type=Path)
    asked = parser.parse_args()
    table = "\n".join(study(asked.seeds, asked.touches))
    print(table)
    if asked.write:
        write_into(asked.write, table)


if __name__ == "__main__":
    main()
