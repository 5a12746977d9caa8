"""Touches of one sphere in the World: the touches that a campaign plans, and where the tip meets the sphere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, Self, final

import numpy as np
import yaml
from scipy.optimize import brentq

from cellctl.calibration import FitResult, RobotModel, Split, Task, fit
from cellctl.formats import DataSet, RobotFile, measurements
from cellctl.formats.artefact import Artefact
from cellctl.planning import PlannedTouch, Plate, RobotPostures, SphereTarget, plan_touches
from cellctl.planning.ways import Reach
from sims.world.drives import Backlash
from sims.world.kinematics import Vector
from tests.helpers.simulated_data import best_rigid
from tests.studies.papers.world import Floats, PaperWorld


@final
@dataclass(frozen=True, eq=False)
class TouchCell:
    """A cell file with spheres on a plate, as cellctl reads it."""

    file: Path
    robot: RobotFile
    artefact: Artefact
    postures: RobotPostures

    @classmethod
    def load(cls, file: Path) -> Self:
        """From the cell file."""
        cell = yaml.safe_load(file.read_text(encoding="utf-8"))
        postures = RobotPostures(tuple(cell["postures"]["home"]), tuple(map(tuple, cell["postures"]["touch"])))
        robot = RobotFile.load(file.parent / cell["model"])
        return cls(file, robot, Artefact.model_validate(cell["artefact"]), postures)

    def planned(self, counts: Sequence[int], seed: int) -> list[PlannedTouch]:
        """The touches that a campaign of this seed plans; counts: of each sphere."""
        low, high = self.robot.limits().T
        plate, tip = self.artefact.plate, self.artefact.tip_radius
        assert plate
        targets = [SphereTarget(each.id, each.centre, each.diameter / 2.0 + tip) for each in self.artefact.spheres]
        reach = Reach(tuple(low.tolist()), tuple(high.tolist()))
        return plan_touches(
            self.robot.chain(),
            self.robot.joint_map(),
            reach,
            self.postures,
            targets,
            counts,
            seed,
            plate=Plate(plate.z, plate.stem_radius),
        )


class TouchedWorld(Protocol):
    """What a touch needs of a `World`."""

    @property
    def backlash(self) -> Backlash | None: ...

    def scatter(self, target: Sequence[float], attempt: int) -> Vector: ...

    def gap(self, readings: Sequence[float], scatter: Vector) -> tuple[float, int]: ...


def contacts(world: TouchedWorld, touches: Sequence[PlannedTouch]) -> Floats:
    """Readings (N, n), deg, at which the tip meets the sphere on each planned line; a line that misses is left out."""
    found = [_contact(world, np.array(touch.start), np.array(touch.end)) for touch in touches]
    return np.array([one for one in found if one is not None])


def _contact(world: TouchedWorld, start: Floats, end: Floats) -> Floats | None:
    scatter = world.scatter(end.tolist(), 0)
    play = world.backlash
    ahead = np.array(play.behind(np.sign(end - start).astype(int).tolist())) if play else np.zeros(len(start))

    def gap(share: float) -> float:
        return world.gap((start + share * (end - start) + ahead).tolist(), scatter)[0]

    if gap(0.0) <= 0.0 or gap(1.0) >= 0.0:
        return None
    return np.asarray(start + brentq(gap, 0.0, 1.0, xtol=1e-9) * (end - start))


@final
@dataclass(frozen=True, eq=False)
class Touched:
    """Touches of one sphere, the last `held_out` of them not for the fit, in random order."""

    cell: TouchCell
    readings: Floats
    held_out: int

    def task(self) -> Task:
        """The published identification: geometry, tool and its deflection."""
        sphere = self.cell.artefact.spheres[0]
        rows: list[dict[str, Any]] = [
            {
                **{f"A{axis}": float(value) for axis, value in enumerate(row, 1)},
                "sphere": sphere.id,
                "radius": sphere.diameter / 2.0,
                "tip_radius": self.cell.artefact.tip_radius,
            }
            for row in self.readings
        ]
        data = DataSet.of_records(rows, "touches.csv")
        task = measurements(
            self.cell.robot,
            data,
            measure="sphere",
            model="geometry+deflection",
            artefact=self.cell.artefact,
            use_distances=False,
        ).task
        return replace(task, groups=frozenset({"geometry", "tool", "deflection"}))

    def fitted(self, task: Task) -> FitResult:
        """The fit with its figures on the held-out touches."""
        return fit(task, Split.by_column(np.arange(len(self.readings)) >= len(self.readings) - self.held_out))


def touched(cell: TouchCell, world: PaperWorld, fit_count: int, held_out: int) -> Touched:
    """`fit_count` + `held_out` touches of the world's robot, as the campaign plans them, in random order."""
    readings = contacts(world.world, cell.planned([fit_count + held_out], world.seed))
    return Touched(cell, readings[world.draws("order").permutation(len(readings))], held_out)


def volumetric(found: RobotModel, robot: RobotFile, readings: Floats, true: Floats) -> float:
    """3-D RMS, mm, of predicted from true TCPs (N, 3), the best rigid motion removed."""
    points = found.tcp(robot.joint_map().model(readings))
    return float(np.sqrt(np.mean(np.sum((best_rigid(points, true).apply(points) - true) ** 2, axis=1))))
