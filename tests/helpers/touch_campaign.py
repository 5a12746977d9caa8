"""A sphere campaign without wires: its steps plan, decide and identify; the touches are of the simulated world."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from cellctl.files import load_yaml
from cellctl.formats import ModelFile
from cellctl.kinematics import Floats
from cellctl.procedure import StepRegistry
from procedures.steps.batches import Task
from procedures.steps.sphere._known import contact
from procedures.steps.sphere.planning import even_counts, plan_on
from procedures.steps.sphere.reference_touches import reference_row
from procedures.steps.sphere.rows import TouchRow
from procedures.steps.sphere.touch_plans import TouchPlan
from sims.cell import read_cell
from sims.world.world import World
from tests.helpers.runs import CELL
from tests.helpers.simulated_data import KR5_FILE, best_rigid
from tests.helpers.steps import CONTACT, Context

SPHERES = ("S1", "S2", "S3")
SECONDS = 12.0
"""Of the cell's time for a touch."""


class TouchCampaign:
    """A campaign of the robot `seed`; its rows are in `context`."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.context = Context(run_folder=folder, robot_file=KR5_FILE, cell=load_yaml(CELL))
        self.context.seed = seed  # type: ignore[attr-defined]
        self.world, self.steps = World(read_cell(CELL), seed), StepRegistry.installed()

    def do(self, name: str, **inputs: Any) -> Any:
        """The result of a step."""
        kind = self.steps.find(name)
        return asyncio.run(kind(self.context, kind.inputs(**inputs)))

    def touch(self, plans: Sequence[TouchPlan]) -> None:
        """Make these touches, and record them."""
        for plan in plans:
            found = {"number": plan.number, "sphere": plan.sphere, "set": plan.set, "joints": self._contact(plan)}
            row = TouchRow(**CONTACT | found | {"time_ns": round(1e9 * SECONDS * plan.number)})
            self.context.rows.append(row if plan.repeats is None else reference_row(self.context, row, plan.repeats))

    def _contact(self, plan: TouchPlan) -> tuple[float, ...]:
        """Readings, deg, where the tip meets the sphere."""
        start, end = np.array(plan.start), np.array(plan.end)
        scatter = self.world.scatter(plan.end, plan.number)

        def gap(share: float) -> float:
            return self.world.gap((start + share * (end - start)).tolist(), scatter)[0]

        share = brentq(gap, 0.0, 1.0, xtol=1e-9)
        return tuple(round(angle, 6) for angle in self.world.encoder((start + share * (end - start)).tolist()))

    def error(self, model: ModelFile, readings: Floats) -> float:
        """3-D RMS, mm, of the model's places from the true ones."""
        predicted = np.array(model.predict(readings).poses)[:, :3, 3]
        true = np.array([self.world.true_tcp(each) for each in readings.tolist()])
        return float(np.sqrt(np.mean(np.sum((best_rigid(predicted, true).apply(predicted) - true) ** 2, axis=1))))

    def goal_places(self, model: ModelFile, held_out: int) -> Floats:
        """Readings (N, n), deg, over which the goal is: about the held-out touches with which a campaign with a goal
        begins that has `held_out` of them.
        """
        counts = even_counts(held_out - held_out // 2, len(SPHERES))[::-1]
        touches = plan_on(self.context, dict(zip(SPHERES, counts, strict=True)), self.context.seed)
        joints = model.robot.joint_map()
        return joints.readings(Task.about(np.array([contact(touch) for touch in touches]), joints).places)
