"""Run folders made here: touches of a robot whose errors are known, a journal written event by event."""

import json
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.calibration import Split, fit
from cellctl.files import parse_yaml, sha256_of
from cellctl.formats import DataSet, ModelFile, RobotFile, artefact_of, fit_report, measurements, nominal_model
from cellctl.journal import (
    DevicesConnected,
    Journal,
    Outcome,
    Recorded,
    RunEnded,
    RunStarted,
    SourceFile,
    StateChanged,
    StepEnded,
    StepFailure,
    StepStarted,
)
from cellctl.kinematics import inverse
from cellctl.report.fit import FitStory, identification_rows
from tests.helpers.journals import SEARCH

ROBOT = Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml"
PROCEDURE = "procedure: campaign\ntitle: Touches & <b>proof</b>\n"
CELL = """
name: a cell
model: robot.yaml
artefact:
  tip_radius: 0.6
  spheres:
    - {id: S1, diameter: 61.4, centre: [950, -350, 250]}
    - {id: S2, diameter: 61.4, centre: [950, 350, 250]}
    - {id: S3, diameter: 61.4, centre: [1150, 0, 400]}
  distances:
    - {between: [S1, S2], mm: 700.0, sigma: 0.01}
    - {between: [S2, S3], mm: 430.1163, sigma: 0.01}
"""
SPHERES = {"S1": (950.0, -350.0, 250.0), "S2": (950.0, 350.0, 250.0), "S3": (1150.0, 0.0, 400.0)}
REACH = 61.4 / 2 + 0.6
ERRORS = {"theta2": 0.002, "theta3": -0.001, "a2": 0.6, "d4": -0.5, "tool_x": 1.0}
NOISE_MM = 0.01


def touches_of_a_robot_with_known_errors(number, spoil=None):
    """Rows as the `touch` step records them; touch `spoil` is 2 mm off."""
    robot = RobotFile.load(ROBOT)
    nominal = nominal_model(robot, touched=False)
    true = nominal.with_deviations([ERRORS.get(name, 0.0) for name in nominal.names])
    random = np.random.default_rng(5)
    limits, joints, rows = robot.limits(), robot.joint_map(), []
    while len(rows) < number:
        sphere = f"S{len(rows) % 3 + 1}"
        tilt, lean = random.uniform(0.0, 70.0), random.uniform(-40.0, 40.0)
        around, spin = random.uniform(-180.0, 180.0, 2)
        turn = Rotation.from_euler("ZY", [around, tilt], degrees=True)
        normal = turn.apply([0.0, 0.0, 1.0])
        distance = REACH + random.normal(0.0, NOISE_MM) + (2.0 if len(rows) == spoil else 0.0)
        pose = np.eye(4)
        pose[:3, :3] = (turn * Rotation.from_euler("XYZ", [180.0, lean, spin], degrees=True)).as_matrix()
        pose[:3, 3] = np.array(SPHERES[sphere]) + distance * normal
        heading = -np.degrees(np.arctan2(pose[1, 3], pose[0, 3]))
        found = inverse(true.chain, pose, joints.model(np.array([heading, -60.0, 90.0, 0.0, 60.0, 0.0])))
        readings = joints.readings(found.q)
        if found.converged and (readings > limits[:, 0]).all() and (readings < limits[:, 1]).all():
            rows.append(touch_row(len(rows), sphere, readings))
    return rows


def touch_row(number, sphere, readings):
    return {
        "number": number,
        "sphere": sphere,
        "set": "test" if number % 4 == 3 else "fit",
        "joints": [round(float(value), 6) for value in readings],
        "resting": [round(float(value) + 0.005, 6) for value in readings],
        **SEARCH,
        "lost": 1 if number == 7 else 0,
    }


@dataclass(frozen=True)
class Campaign:
    """Touches, what a fit of them came to, and the rows that the identification stores of it."""

    touches: list
    data: DataSet
    model: ModelFile
    verdict: dict
    story: FitStory
    rows: tuple


@pytest.fixture(scope="session")
def campaign():
    return fitted(touches_of_a_robot_with_known_errors(64))


@pytest.fixture(scope="session")
def spoilt_campaign():
    return fitted(touches_of_a_robot_with_known_errors(64, spoil=20))


def fitted(touches):
    robot = RobotFile.load(ROBOT)
    records = [
        {
            **{f"A{axis}": value for axis, value in enumerate(row["joints"], 1)},
            **{name: row[name] for name in ("sphere", "set")},
            "touch": row["number"],
        }
        for row in touches
    ]
    data = DataSet.of_records(records, "dataset.csv")
    artefact = artefact_of(parse_yaml(CELL, "cell.yaml"), ("artefact",))
    measured = measurements(robot, data, measure="sphere", artefact=artefact)
    split = Split.by_column(np.array([of == "test" for of in measured.sets]))
    result = fit(measured.task, split)
    report = fit_report(measured, result)
    verdict = {
        "verdict": report["verdict"],
        "sentence": report["sentence"],
        "before": report["nominal"],
        "after": report["test"],
        "model": report,
        "stops": {
            "overtravel_mean_mm": 0.171,
            "overtravel_max_mm": 0.186,
            "stop_cycles_max": 2,
            **dict.fromkeys(("late", "lost", "skipped"), 0),
        },
        "drift": {
            "visits": 0,
            "mm_per_touch": 0.0,
            "sigma_mm_per_touch": 0.0,
            "t": 0.0,
            "significant": False,
            "total_mm": 0.0,
            "modelled": False,
        },
    }
    story = FitStory.of(measured, result, split, report)
    provenance = {"data_sha256": sha256_of(data.text())}
    return Campaign(
        touches, data, ModelFile.of(robot, measured, result, provenance), verdict, story, identification_rows(story)
    )


def run_folder(
    folder,
    campaign=None,
    *,
    rows=(),
    verdict=None,
    ended="finished",
    reason="",
    failed="",
    real=False,
    table=None,
    cell="",
):
    """A run's folder. campaign: with its touches, data set, model and verdict; rows: (kind, data) besides;
    verdict: added to the verdict's fields; failed: text of a step's failure; ended None: the process died.
    cell: added to the cell file.
    """
    folder.mkdir(parents=True)
    ticks = count(0, 1_000_000_000)
    cell = CELL + cell + ("" if real else "simulate: {seed: 1}\n")
    with Journal.create(folder, lambda: next(ticks)) as journal:
        journal.append(_started(cell))
        journal.append(StateChanged("idle", "running"))
        robot = {"model": "KR5", "serial": "SIM-1" if not real else "1", "firmware": "8.6", "simulated": not real}
        journal.append(DevicesConnected({"robot": robot}))
        for row in campaign.touches if campaign else ():
            journal.append(Recorded("touch", row))
        for row in campaign.rows if campaign else ():
            journal.append(Recorded(row.KIND, row.data()))
        for kind, row in rows:
            journal.append(Recorded(kind, row))
        if campaign and campaign.verdict is not None:
            journal.append(Recorded("verdict", {**campaign.verdict, **(verdict or {})}))
        if failed:
            journal.append(StepStarted("points[3].touch", 1, True))
            journal.append(StepEnded("points[3].touch", 1, Outcome.FAILED, None, StepFailure("DeviceLost", failed)))
        if ended:
            journal.append(RunEnded(ended, "better" if campaign else "", reason))
    if campaign and campaign.model is not None:
        campaign.data.write(folder / "dataset.csv")
        campaign.model.save(folder / "model.json")
    if table is not None:
        (folder / "table.json").write_text(json.dumps(table))
    return folder


def _started(cell):
    return RunStarted(
        procedure=SourceFile("campaign.yaml", PROCEDURE, sha256_of(PROCEDURE)),
        cell=SourceFile("cell.yaml", cell, sha256_of(cell)),
        parameters={"touches_fit": 48, "search_speed": 5.0},
        seed=1,
        clock="lockstep",
        operator="somebody",
        calendar="2026-11-21T20:30:02Z",
        code_sha256="c0de" * 16,
        versions={"cellctl": "0.1.0", "python": "3.11.7"},
    )


@pytest.fixture
def make_run(tmp_path):
    """`make_run(campaign, …)`: a run folder, see `run_folder`."""
    return _maker(tmp_path)


@pytest.fixture(scope="module")
def make_run_once(tmp_path_factory):
    """`make_run` for runs that no test changes."""
    return _maker(tmp_path_factory.mktemp("runs"))


def _maker(folder):
    numbers = count(1)
    return lambda *args, **settings: run_folder(folder / f"run-{next(numbers)}", *args, **settings)
