"""Model files without a fit: a robot of the library, its parameters off by known amounts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cellctl.calibration import settings_of
from cellctl.files import parse_yaml
from cellctl.formats import ModelFile, RobotFile
from cellctl.formats.description import RobotDescription, robot_text
from cellctl.formats.measurements import nominal_model
from cellctl.formats.model import JointRegion, Parameter

ROBOTS = Path(__file__).parents[2] / "procedures" / "robots"
BASE = [[0.8, -0.6, 0.0, 1200.0], [0.6, 0.8, 0.0, -300.0], [0.0, 0.0, 1.0, 150.0], [0.0, 0.0, 0.0, 1.0]]
TOOL = [[1.0, 0.0, 0.0, 40.0], [0.0, 0.0, -1.0, 25.0], [0.0, 1.0, 0.0, 180.0], [0.0, 0.0, 0.0, 1.0]]


def library_robot(name: str) -> RobotFile:
    return RobotFile.load(ROBOTS / f"{name}.yaml")


def by_axes(robot: RobotFile) -> RobotFile:
    """The same robot by its joints' axes (poe)."""
    return RobotFile.from_document(parse_yaml(robot_text(RobotDescription.of(robot), "poe", "robot"), "robot.yaml"))


def model_of(robot: RobotFile, values: dict[str, float], effects: tuple = (), region=None) -> ModelFile:
    """The model of `robot` with deviations `values` (mm, rad, units of effects) by name, others 0. region: readings
    (2, n), deg; None: the joint limits."""
    placed = nominal_model(robot).with_effects(effects).on(BASE, TOOL)
    assert values.keys() <= set(placed.names)
    ends = robot.limits().T if region is None else np.asarray(region)
    return ModelFile(
        robot=robot,
        model="geometry",
        start={"base": BASE, "tool": TOOL},
        effects=[settings_of(effect) for effect in effects],
        parameters=[
            Parameter(name=each.name, unit=each.unit.name, value=values.get(each.name, 0.0), sigma=0.0, prior_sigma=1.0)
            for each in placed.parameters
        ],
        covariance=np.zeros((len(placed.parameters),) * 2).tolist(),
        joint_region=JointRegion(min=ends[0].tolist(), max=ends[1].tolist()),
        figures={},
        provenance={},
    )


def perturbed(robot: RobotFile, seed: int, angle: float, length_mm: float) -> ModelFile:
    """All parameters of the chain off, normally distributed: angles by `angle` (rad), lengths by `length_mm`."""
    chain, rng = nominal_model(robot).on(BASE, TOOL).chain, np.random.default_rng(seed)
    sizes = np.where(chain.parameter_turns, angle, length_mm) * rng.standard_normal(len(chain.parameters))
    return model_of(robot, dict(zip(chain.parameters, sizes.tolist(), strict=True)))
