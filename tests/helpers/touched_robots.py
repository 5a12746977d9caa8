"""Robots of the flexible sphere cell that touch its three spheres by computation, without wires.

Its own compliance, gears and play, or errors of `unmodelled.FLEXIBLE` in their place.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellctl.calibration import FitResult, Split, Task, fit
from cellctl.formats import DataSet, measurements
from cellctl.kinematics import Bools, Floats, JointMap
from sims.world import World
from sims.world.drives import Backlash
from sims.world.kinematics import Vector
from tests.helpers.own_model import ErrorsOfJoints, kr5
from tests.helpers.runs import ROOT
from tests.studies.papers.touching import TouchCell, contacts
from tests.studies.papers.world import PaperWorld

CELL = ROOT / "procedures/cells/flexible_sphere_cell.yaml"
RIGID = {"compliance": 0.0, "gear": 0.0, "backlash": 0.0}
FITTED = {"S1": 17, "S2": 17, "S3": 16}
HELD_OUT = 10
"""Touches of each sphere."""

PLAYING = (1, 2, 4)
"""Joints (from 0) with play, of robots with errors of `unmodelled`."""


ARM = kr5()
"""Carries the weight that the errors of `unmodelled` need; the robot file's chain is the same."""


@dataclass(frozen=True, eq=False)
class ErringWorld:
    """A rigid world whose joints err, and play in `PLAYING`. Readings in degrees, as in the world."""

    rigid: World
    errors: ErrorsOfJoints
    joints: JointMap
    backlash: Backlash

    @classmethod
    def of(cls, cell: TouchCell, seed: int, errors: ErrorsOfJoints) -> ErringWorld:
        rigid = PaperWorld.of(CELL, seed, RIGID).world
        backlash = Backlash(len(cell.robot.joints), seed, 1.0)
        backlash.half_deg = tuple(half * (joint in PLAYING) for joint, half in enumerate(backlash.half_deg))
        return cls(rigid, errors, cell.robot.joint_map(), backlash)

    def scatter(self, target: Sequence[float], attempt: int) -> Vector:
        return self.rigid.scatter(target, attempt)

    def gap(self, readings: Sequence[float], scatter: Vector) -> tuple[float, int]:
        return self.rigid.gap(self._links_at(readings), scatter)

    def true_tcp(self, readings: Sequence[float]) -> Vector:
        return self.rigid.true_tcp(self._links_at(readings))

    def _links_at(self, readings: Sequence[float]) -> list[float]:
        q = self.joints.model([readings])
        links: list[float] = self.joints.readings(q + self.errors.at(q, ARM.links))[0].tolist()
        return links


@dataclass(frozen=True, eq=False)
class Touched:
    """Touches of one robot, `held_out` (N,) of them not for the fit; `world` knows the truth."""

    cell: TouchCell
    world: World | ErringWorld
    task: Task
    held_out: Bools

    def fitted(self) -> FitResult:
        """Fit and verdict."""
        return fit(self.task, Split.by_column(self.held_out))

    def true(self, q: Floats) -> Floats:
        """True TCPs (N, 3), mm, at model angles q (N, n), rad."""
        readings = self.cell.robot.joint_map().readings(q)
        return np.array([self.world.true_tcp(row) for row in readings.tolist()])


def touched(seed: int, errors: ErrorsOfJoints | None = None) -> Touched:
    """50 touches for the fit and 30 held-out ones, of a robot with the cell's own errors, or with these."""
    cell = TouchCell.load(CELL)
    world = ErringWorld.of(cell, seed, errors) if errors else PaperWorld.of(CELL, seed).world
    counts = [FITTED.get(sphere.id, -HELD_OUT) + HELD_OUT for sphere in cell.artefact.spheres]
    tip = cell.artefact.tip_radius
    sphere = {each.id: {"radius": each.diameter / 2.0, "tip_radius": tip} for each in cell.artefact.spheres}
    rows = [
        {**{f"A{axis}": value for axis, value in enumerate(row, 1)}, "sphere": touch.sphere, **sphere[touch.sphere]}
        for touch in cell.planned(counts, seed)
        for row in contacts(world, [touch]).tolist()
    ]
    rows = [rows[index] for index in np.random.default_rng([seed, 28]).permutation(len(rows))]
    seen: Counter[str] = Counter()
    held_out = []
    for row in rows:
        held_out.append(seen[row["sphere"]] >= FITTED[row["sphere"]])
        seen[row["sphere"]] += 1
    data = DataSet.of_records(rows, "touches.csv")
    task = measurements(cell.robot, data, measure="sphere", model="auto", artefact=cell.artefact).task
    return Touched(cell, world, task, np.array(held_out))
