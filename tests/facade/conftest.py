"""A three-joint arm whose errors are known, measured in 60 postures, as files."""

import numpy as np
import pytest

import cellctl
from cellctl.files import parse_yaml
from cellctl.formats import RobotFile
from tests.helpers.arms import ELBOW_ROBOT, ElbowArm, csv_text, drawn, joints_and_places


@pytest.fixture(scope="session")
def columns():
    """Readings and measured positions, by column; forty rows to fit and twenty held out."""
    rng = np.random.default_rng(4)
    readings = drawn(rng, 60)
    places = ElbowArm().tcp(readings) + rng.normal(0.0, 0.012, (60, 3))
    return {**joints_and_places(readings, places), "set": ["fit"] * 40 + ["test"] * 20}


@pytest.fixture
def files(tmp_path, columns, monkeypatch):
    """`robot.yaml` and `data.csv` in the working folder."""
    (tmp_path / "robot.yaml").write_text(ELBOW_ROBOT)
    (tmp_path / "data.csv").write_text(csv_text(columns))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def model(columns):
    """The arm's geometry, fitted once for all tests."""
    robot = RobotFile.from_document(parse_yaml(ELBOW_ROBOT, "robot.yaml"))
    return cellctl.fit(robot, columns, model="geometry")
