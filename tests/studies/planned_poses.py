"""Planned poses of the tracker cell beside more random ones, in the worst place (20 minutes).

Simulated KR5 are measured at the poses that `tracker_calibration` plans: 25 with `choice=optimal`, and 25 and 60 of
today's random ones. Reflector places come from the simulator's world, with its repeatability and 0.05 mm, 1 σ on each
axis, of the instrument; no wires. Judged at 512 other poses that the instrument could see, the best rigid motion
removed: RMS, and the largest error of all.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from functools import cache

import numpy as np

from cellctl.calibration import Split, fit
from cellctl.files import load_yaml
from cellctl.formats import DataSet, RobotFile, measurements, postures_of
from cellctl.formats.measurements.columns import SIGMA_COLUMNS
from cellctl.planning.measuring_poses import MeasuringArm, measuring_postures
from procedures.steps.tracker.plan_inputs import PlanInputs
from procedures.steps.tracker.pose_planning import planned_rounds, pose_limits
from procedures.steps.tracker.pose_plans import PosePlan
from sims.cell import read_cell
from sims.world.world import World
from tests.helpers.arms import KR5_FILE, Floats
from tests.helpers.simulated_data import TRACKER_CELL, best_rigid
from tests.helpers.steps import Context
from tests.studies._runner import Row, Study, Table

INSTRUMENT_MM = 0.05
CASES = ((25, "optimal"), (60, "even"), (25, "even"))
JUDGES, JUDGES_SEED = 512, 987


def units(asked: Namespace) -> Iterator[Row]:
    """Each choice on each robot."""
    for seed in asked.seeds:
        yield from ({"poses": poses, "choice": choice, "seed": seed} for poses, choice in CASES)


def measure(poses: int, choice: str, seed: int) -> Row:
    """The error of the identified robot."""
    inputs = PlanInputs(fit=poses, held_out=0, choice=choice)  # type: ignore[arg-type]
    rounds = planned_rounds(cell_context(seed), inputs, None)
    world, robot = World(read_cell(TRACKER_CELL), seed), RobotFile.load(KR5_FILE)
    data = measured_rows(world, [pose for each in rounds for pose in each.poses], robot.repeatability, seed)
    found = fit(measurements(robot, data, measure="position").task, Split(np.arange(len(data.lines)), ()))
    q = robot.joint_map().model(judges())
    predicted = found.identification.identified.state.model.tcp(q)
    true = np.array([reflector(world, each, (0.0, 0.0, 0.0)) for each in judges().tolist()])
    errors = np.linalg.norm(best_rigid(predicted, true).apply(predicted) - true, axis=1)
    rms = float(np.sqrt(np.mean(errors**2)))
    return {"visits": len(data.lines), "rms": rms, "largest": float(errors.max()), "model": found.model}


def cell_context(seed: int) -> Context:
    """The tracker cell before a run."""
    context = Context(robot_file=KR5_FILE, cell=load_yaml(TRACKER_CELL))
    context.seed = seed  # type: ignore[attr-defined]
    return context


@cache
def judges() -> Floats:
    """Readings (512, 6), deg, at which the reflector can be measured."""
    context, robot = cell_context(JUDGES_SEED), RobotFile.load(KR5_FILE)
    reach, sight, options = pose_limits(context, 1)  # type: ignore[arg-type]
    home = np.array(postures_of(context.cell, robot, "turn").home)
    arm = MeasuringArm(robot.chain().with_base(np.eye(4)), robot.joint_map(), sight, home, options)
    return measuring_postures(arm, reach, JUDGES, JUDGES_SEED)


def reflector(world: World, readings: list[float], scatter: tuple[float, float, float]) -> Floats:
    """True place (3,) of the first reflector in the robot's base frame, mm."""
    place = read_cell(TRACKER_CELL).reflectors.on_flange[0].xyz  # type: ignore[union-attr]
    return np.asarray((world.flange(readings, scatter) @ (*place, 1.0))[:3])


def measured_rows(world: World, poses: list[PosePlan], repeatability: float, seed: int) -> DataSet:
    """The poses of the fit as an instrument measures them."""
    rng = np.random.default_rng([seed, 6])
    sigma = float(np.hypot(INSTRUMENT_MM, repeatability / np.sqrt(3.0)))
    rows = []
    for pose in poses:
        place = reflector(world, pose.joints, world.scatter(pose.joints, 0)) + rng.normal(0.0, INSTRUMENT_MM, 3)
        row = {f"A{axis}": reading for axis, reading in enumerate(pose.joints, 1)}
        row |= {f"D{axis}": side for axis, side in enumerate(pose.direction, 1)}
        rows.append({**row, **dict(zip("XYZ", place.tolist(), strict=True)), **dict.fromkeys(SIGMA_COLUMNS, sigma)})
    return DataSet.of_records(rows, "poses")


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """Medians, and the range of the middle half."""
    lines = ["| poses | choice | robots | workspace RMS, mm | worst place, mm |", "|---|---|---|---|---|"]
    for poses, choice in CASES:
        mine = [row for row in found if (row["poses"], row["choice"]) == (poses, choice)]
        if mine:
            figures = [" … ".join(f"{each:.3f}" for each in _spread(mine, name)) for name in ("rms", "largest")]
            lines.append(f"| {poses} | {choice} | {len(mine)} | {figures[0]} | {figures[1]} |")
    yield Table("\n".join(lines), "planned poses")


def _spread(rows: list[Row], name: str) -> Floats:
    """Lower quartile, median, upper quartile."""
    return np.quantile([row[name] for row in rows], (0.25, 0.5, 0.75))


STUDY = Study(units, measure, tables, seeds=20, first=11, writes=True)
