"""A model file of the KR5 with errors of the test's choice, and targets in front of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from cellctl.formats import ModelFile, RobotFile, nominal_model
from cellctl.formats.model import Centre, JointRegion, Parameter
from tests.helpers.kr5_table import KR5_TABLE

ROBOT = Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml"
ERRORS = {"theta2": 0.003, "theta3": -0.004, "a2": -0.7, "d4": 0.8, "alpha4": 0.0009, "tool_y": -1.1}
MIDDLE = np.array([0.0, -60.0, 80.0, 10.0, 60.0, 20.0])


def kr5_model(*, touches: bool = True, errors: dict[str, float] | None = None, **provenance: str) -> ModelFile:
    """The KR5 with `errors` from its table (mm, rad), sure to 0.05 mm and 0.05 mrad, seen ± 30° around MIDDLE."""
    robot = RobotFile.load(ROBOT)
    nominal = nominal_model(robot, touched=True)
    values = ERRORS if errors is None else errors
    parameters = [
        Parameter(
            name=name,
            unit="1/(N m^2)" if name == "tool_deflection" else "rad" if turns else "mm",
            value=values.get(name, 0.0),
            sigma=_sigma(name, turns),
            prior_sigma=1.0,
        )
        for name, turns in zip(nominal.names, nominal.parameter_turns.tolist(), strict=True)
    ]
    return ModelFile(
        robot=robot,
        model="geometry+deflection",
        start={"base": nominal.chain.base.tolist(), "tool": nominal.chain.tool.tolist()},
        parameters=parameters,
        covariance=np.diag([parameter.sigma**2 for parameter in parameters]).tolist(),
        centres=[Centre(id="S1", xyz=[950.0, -350.0, 250.0], sigma=[0.1, 0.8, 0.5])] if touches else [],
        joint_region=JointRegion(min=(MIDDLE - 30.0).tolist(), max=(MIDDLE + 30.0).tolist()),
        figures={},
        provenance=provenance,
    )


def _sigma(name: str, turns: bool) -> float:
    if name.startswith("base_") or name == "tool_deflection":
        return 0.0
    if name in ("theta1", "d1"):  # what a touch never sees: as wide as it was before
        return 0.00087 if turns else 0.5
    return 5e-5 if turns else 0.05


def readings_near_the_middle(count: int, seed: int = 1) -> np.ndarray:
    """Controller readings (count, 6), deg, up to 20° from MIDDLE."""
    return MIDDLE + np.random.default_rng(seed).uniform(-20.0, 20.0, (count, 6))


def targets_csv(readings: np.ndarray, *, postures: bool = True) -> str:
    """Targets where the nominal KR5's tool is at `readings` (N, 6), deg, by products written out here."""
    names = ["X", "Y", "Z", "QW", "QX", "QY", "QZ", *([f"A{axis}" for axis in range(1, 7)] if postures else [])]
    rows = [[*_place(row), *(row if postures else [])] for row in readings]
    return "\n".join([",".join(names), *(",".join(repr(float(value)) for value in row) for row in rows)]) + "\n"


_SIGNS = (-1, 1, 1, -1, 1, -1)
_TOOL_XYZ, _TOOL_ABC = (59.9, 50.5, 410.3), (38.846, 3.595, 0.040)


def _place(readings: np.ndarray) -> list[float]:
    from scipy.spatial.transform import Rotation

    turn, place = Rotation.identity(), np.zeros(3)
    for (theta, d, a, alpha), sign, reading in zip(KR5_TABLE, _SIGNS, readings, strict=True):
        step = Rotation.from_euler("z", theta + sign * reading, degrees=True)
        place = place + turn.apply(step.apply([a, 0.0, d]))
        turn = turn * step * Rotation.from_euler("x", alpha, degrees=True)
    place = place + turn.apply(_TOOL_XYZ)
    turn = turn * Rotation.from_euler("ZYX", _TOOL_ABC, degrees=True)
    assert math.isfinite(place.sum())
    return [*place.tolist(), *turn.as_quat(scalar_first=True).tolist()]
