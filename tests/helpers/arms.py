"""Robots as files and models: the shipped KR5, an elbow arm in closed form, and robots of the library.

`kr5_model` is a model file of the KR5 with errors of the test's choice. `ElbowArm` has three joints: as its robot file
says, and as it really is, for tests of the way from files. `identified_elbow` makes an older model of it at the command
line, for work that is updated from it. `perturbed` makes model files without a fit: parameters off by known amounts.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cellctl.calibration import Effect, settings_of
from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.files import load_yaml
from cellctl.formats import ModelFile, RobotFile, nominal_model, postures_of
from cellctl.formats.description import in_poe
from cellctl.formats.model import Centre, JointRegion, Parameter
from cellctl.kinematics import Link
from cellctl.planning import RobotPostures
from tests.helpers.own_model import KR5_TABLE

KR5_LINKS = [
    Link(np.deg2rad(theta), d, a, np.deg2rad(alpha), 0.0 if index == 1 else None)
    for index, (theta, d, a, alpha) in enumerate(KR5_TABLE)
]
"""The published table as links of a chain: A2 and A3 are parallel."""

KR5_FILE = Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml"
KR5_ERRORS = {"theta2": 0.003, "theta3": -0.004, "a2": -0.7, "d4": 0.8, "alpha4": 0.0009, "tool_y": -1.1}
KR5_MIDDLE = np.array([0.0, -60.0, 80.0, 10.0, 60.0, 20.0])

_PROCEDURES = Path(__file__).parents[2] / "procedures"
_FOUND = postures_of(
    load_yaml(_PROCEDURES / "cells" / "sphere_cell.yaml"),
    RobotFile.load(_PROCEDURES / "robots" / "kr5_r1400.yaml"),
    "touch",
)
KR5_POSTURES = RobotPostures(tuple(_FOUND.home), tuple(map(tuple, _FOUND.touch)))
"""As the shipped cell file has them."""

Floats = NDArray[np.float64]
ELBOW_ROBOT = """\
name: elbow arm
convention: mdh-hayati
links:
  - {theta: 0, d: 400, a: 0, alpha: 90}
  - {theta: 0, a: 500, alpha: 0, beta: 0}
  - {theta: 0, d: 0, a: 450, alpha: 0}
joints:
  - {sign: 1, offset: 0, min: -180, max: 180, max_speed: 100}
  - {sign: -1, offset: 10, min: -180, max: 180, max_speed: 100}
  - {sign: 1, offset: 0, min: -180, max: 180, max_speed: 100}
repeatability: 0.02
"""
"""The second joint counts downwards from 10° above the horizontal."""
ELBOW_LOWER, ELBOW_UPPER = np.array([-90.0, -70.0, -120.0]), np.array([90.0, 0.0, -30.0])

ROBOTS = Path(__file__).parents[2] / "procedures" / "robots"
BASE = [[0.8, -0.6, 0.0, 1200.0], [0.6, 0.8, 0.0, -300.0], [0.0, 0.0, 1.0, 150.0], [0.0, 0.0, 0.0, 1.0]]
TOOL = [[1.0, 0.0, 0.0, 40.0], [0.0, 0.0, -1.0, 25.0], [0.0, 1.0, 0.0, 180.0], [0.0, 0.0, 0.0, 1.0]]


def kr5_model(*, touches: bool = True, errors: dict[str, float] | None = None, **provenance: str) -> ModelFile:
    """The KR5 with `errors` from its table (mm, rad), sure to 0.05 mm and 0.05 mrad, seen ± 30° around KR5_MIDDLE."""
    robot = RobotFile.load(KR5_FILE)
    nominal = nominal_model(robot, touched=True)
    values = KR5_ERRORS if errors is None else errors
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
        joint_region=JointRegion(min=(KR5_MIDDLE - 30.0).tolist(), max=(KR5_MIDDLE + 30.0).tolist()),
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
    """Controller readings (count, 6), deg, up to 20° from KR5_MIDDLE."""
    return KR5_MIDDLE + np.random.default_rng(seed).uniform(-20.0, 20.0, (count, 6))


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


@dataclass(frozen=True)
class ElbowArm:
    """The arm as it is. Lengths in mm at 20 °C; zero_deg: the elbow's error; growth: of all lengths, 1/K; play_deg: by
    which the shoulder stays behind where it moves upwards, and ahead where it moves downwards; tool: beyond the tip
    along the forearm, up from it, and to its right, mm. turn_deg, at: where the arm stands in the instrument's frame.
    lost_deg: by how much less each joint reads than it did before a crash.
    """

    upper: float = 500.8
    fore: float = 449.3
    zero_deg: float = 0.03
    growth: float = 0.0
    play_deg: float = 0.0
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0
    at: tuple[float, float, float] = (1000.0, 20.0, -30.0)
    lost_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def tcp(self, readings: Floats, celsius: Floats | float = 20.0, upwards: Floats | float = 0.0) -> Floats:
        """The tip (N, 3), mm, in the instrument's frame, at readings (N, 3), deg; upwards (N,): 1, -1 or 0."""
        read = readings + np.array(self.lost_deg)
        turn, shoulder = np.radians(read[:, 0]), np.radians(10.0 - read[:, 1] - self.play_deg * upwards)
        elbow = shoulder + np.radians(read[:, 2] + self.zero_deg)
        grown = 1.0 + self.growth * (celsius - 20.0)
        along, up, right = self.tool
        out = grown * (self.upper * np.cos(shoulder) + self.fore * np.cos(elbow))
        out = out + along * np.cos(elbow) - up * np.sin(elbow)
        height = grown * (400.0 + self.upper * np.sin(shoulder) + self.fore * np.sin(elbow))
        height = height + along * np.sin(elbow) + up * np.cos(elbow)
        x, y = out * np.cos(turn) + right * np.sin(turn), out * np.sin(turn) - right * np.cos(turn)
        c, s = np.cos(np.radians(self.turn_deg)), np.sin(np.radians(self.turn_deg))
        return np.stack([c * x - s * y, s * x + c * y, height], axis=1) + np.array(self.at)

    def reaching(self, points: Floats, rng: np.random.Generator) -> Floats:
        """Readings (N, 3) that put the tip at `points` (N, 3) (Newton)."""
        q = np.tile((ELBOW_LOWER + ELBOW_UPPER) / 2.0, (len(points), 1)) + rng.uniform(-5.0, 5.0, (len(points), 3))
        for _ in range(60):
            sides = [(self.tcp(q + h) - self.tcp(q - h)) / 2e-4 for h in 1e-4 * np.eye(3)]
            step = np.linalg.solve(np.stack(sides, axis=-1), (self.tcp(q) - points)[..., None])[..., 0]
            q = q - np.clip(step, -10.0, 10.0)
        return q


def drawn(rng: np.random.Generator, count: int) -> Floats:
    """Readings (count, 3), deg, all over the arm's region."""
    return rng.uniform(ELBOW_LOWER, ELBOW_UPPER, (count, 3))


def csv_text(columns: dict[str, object]) -> str:
    """A data set's text from columns, each a list of cells."""
    cells = [list(column) for column in columns.values()]  # type: ignore[call-overload]  # each is a sequence
    rows = [",".join(_cell(value) for value in row) for row in zip(*cells, strict=True)]
    return "\n".join([",".join(columns), *rows]) + "\n"


def joints_and_places(readings: Floats, places: Floats) -> dict[str, object]:
    """Columns A1, A2, A3, X, Y, Z."""
    return {**{f"A{j + 1}": readings[:, j] for j in range(3)}, **{n: places[:, i] for i, n in enumerate("XYZ")}}


def _cell(value: object) -> str:
    return value if isinstance(value, str) else repr(float(value))  # type: ignore[arg-type]  # numbers else


def cellctl(*words: object) -> int:
    """The exit code of a call of the command line."""
    return exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


def printed_errors(capsys: pytest.CaptureFixture[str]) -> str:
    """The errors that a call printed, without their number; progress of a slow call comes before them."""
    return re.split(r"cellctl: \d+ errors?\n", capsys.readouterr().err)[-1].strip()


def identified_elbow(folder: Path, before: str) -> Path:
    """`folder` with the robot file, and with `model.json` identified from the data set `before`."""
    (folder / "robot.yaml").write_text(ELBOW_ROBOT)
    (folder / "before.csv").write_text(before)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert cellctl("fit", "robot.yaml", "before.csv", "--model", "geometry", "--out", "model.json") == 0
    return folder


def library_robot(name: str) -> RobotFile:
    return RobotFile.load(ROBOTS / f"{name}.yaml")


def by_axes(robot: RobotFile) -> RobotFile:
    """The same robot by its joints' axes (poe)."""
    return in_poe(robot)


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


def names_of(effect: Effect) -> tuple[str, ...]:
    """Of its amounts (K,), in their order."""
    return tuple(parameter.name for parameter in effect.parameters)
