"""A unit of a study of fits: a robot with drawn errors, measured by an instrument, identified as `cellctl fit` does it.

The robot's parameters are drawn from its tolerances; joints are drawn within its limits. The identified model is judged
by the robot that was drawn, at postures that were not measured.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cellctl.calibration import RobotModel
from cellctl.files import InputError, Problem
from cellctl.formats import DataSet, ModelFile, RobotFile
from cellctl.formats.measurements import tolerances_of
from cellctl.installed import shipped_file
from cellctl.kinematics import Floats
from cellctl.operations.fit_options import Asked, Judging
from cellctl.operations.fitting import FitInput, fit_rows, robot_of

SETTINGS: dict[str, Any] = {
    "robot": None,
    "model": "geometry",
    "rows": None,
    "noise_mm": 0.03,
    "spread": 1.0,
    "gear_deg": 0.0,
    "range": 0.8,
    "folds": 5,
}
"""robot: a file or a library robot. noise_mm: 1 σ of each coordinate. spread: errors in units of the tolerances.
gear_deg: amplitude of an error of each joint's gear, once per turn. range: share of each joint's range, about its
middle, in which rows and judging postures are. folds: 0: no row is held out."""

PLOTTED = ("error_rms_mm", "predicted_rms_mm")

JUDGED = 200
"""Postures at which the identified robot is compared with the drawn one."""


def check(folder: Path, unit: dict[str, Any]) -> None:
    """Raise InputError for settings that cannot be used; robot files are relative to `folder`."""
    problems = []
    for name, least, most in (("rows", 3, 1e5), ("noise_mm", 0, 1e3), ("spread", 0, 1e3), ("gear_deg", 0, 45)):
        problems += _outside(unit, name, least, most)
    problems += [*_outside(unit, "range", 0.01, 1), *_outside(unit, "folds", 0, 100)]
    if unit["folds"] == 1:
        problems.append(Problem("folds", 0, 0, "1 is too few", "2 or more; 0: no row is held out"))
    if problems:
        raise InputError(problems)
    Asked("position", str(unit["model"]), None, True, (), "base", None, None).refuse(Judging(None, None, None, None, 0))
    robot_of(_robot_file(folder, unit))


def _outside(unit: dict[str, Any], name: str, least: float, most: float) -> list[Problem]:
    value, whole = unit[name], name in ("rows", "folds")
    if isinstance(value, int if whole else int | float) and not isinstance(value, bool) and least <= value <= most:
        return []
    kind = "whole number" if whole else "number"
    return [Problem(name, 0, 0, f"{value!r} cannot be used", f"a {kind} from {least:g} to {most:g}")]


def _robot_file(folder: Path, unit: dict[str, Any]) -> Path:
    beside = folder / str(unit["robot"])
    return beside if beside.is_file() else shipped_file("robot", Path(str(unit["robot"])))


def measure(beside: str, folder: str, keep: str, **unit: Any) -> dict[str, Any]:
    """The figures of one fit, mm: errors of the identified robot and of nominal against the drawn one; predicted.

    beside: folder that files are relative to. folder, keep: of campaigns; a fit writes no file.
    """
    document, robot = robot_of(_robot_file(Path(beside), unit))
    robot.refuse_prismatic(document.file, "a study of fits")
    rng = np.random.default_rng([unit["seed"], 30])
    truth = _drawn(robot, unit["spread"], rng)
    phases = rng.uniform(0.0, 2.0 * np.pi, robot.n)
    lower, upper = np.array(robot.limits(), float).T
    middle, half = (lower + upper) / 2.0, (upper - lower) / 2.0 * unit["range"]
    readings = rng.uniform(middle - half, middle + half, (unit["rows"] + JUDGED, robot.n))
    bent = robot.joint_map().model(readings + unit["gear_deg"] * np.sin(np.deg2rad(readings) + phases))
    exact, nominal = truth.chain.forward(bent)[:, :3, 3], robot.chain().forward(robot.joint_map().model(readings))
    measured = exact[: unit["rows"]] + rng.normal(0.0, unit["noise_mm"], (unit["rows"], 3))
    names = [*(f"A{joint}" for joint in range(1, robot.n + 1)), "X", "Y", "Z"]
    rows = np.column_stack([readings[: unit["rows"]], measured]).tolist()
    part = {} if unit["folds"] else {"set": "fit"}
    data = DataSet.of_records([{**dict(zip(names, row, strict=True)), **part} for row in rows], "simulated rows")
    asked = Asked("position", str(unit["model"]), None, True, (), "base", None, None)
    judging = Judging(None, unit["folds"] or None, None, None, unit["seed"])
    found = fit_rows(FitInput(document, robot, data), asked, judging, check=False, processes=1)
    after = _errors(found.model(), robot, readings[unit["rows"] :], exact[unit["rows"] :])
    before = np.linalg.norm(nominal[unit["rows"] :, :3, 3] - exact[unit["rows"] :], axis=1)
    return {
        "error_rms_mm": float(np.sqrt(np.mean(after**2))),
        "error_max_mm": float(after.max()),
        "nominal_rms_mm": float(np.sqrt(np.mean(before**2))),
        "predicted_rms_mm": found.report["predicted_volumetric_rms"],
        "verdict": found.report["verdict"],
        "sigma_ok": found.report["sigma_ok"],
        "identified_model": found.report["model"],
        "outliers": len(found.result.identification.outliers),
    }


def _drawn(robot: RobotFile, spread: float, rng: np.random.Generator) -> RobotModel:
    """A robot of this type: base and tool as in the file, every other parameter with an error."""
    model, tolerances = RobotModel(robot.chain()), tolerances_of(robot)
    angle = {"zeros": tolerances.joint_zero_deg}
    sigma = [
        0.0
        if parameter.group in ("base", "tool")
        else np.deg2rad(angle.get(parameter.group, tolerances.angle_deg))
        if parameter.turns
        else tolerances.link_mm
        for parameter in model.parameters
    ]
    return model.with_deviations(spread * rng.normal(0.0, sigma))


def _errors(model: ModelFile, robot: RobotFile, readings: Floats, exact: Floats) -> Floats:
    """Distances (N,), mm, of the identified robot's TCP from the drawn one's."""
    places = model.robot_model().tcp(robot.joint_map().model(readings))
    return np.asarray(np.linalg.norm(places - exact, axis=1))
