"""A new residual model is a class and a line of the tuple: fit, model file, σ and region of a prediction know it."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest
import yaml

from cellctl.calibration import Parameter, Split, effects, fit
from cellctl.calibration.effects import EFFECTS, ResidualModel
from cellctl.calibration.model.parameter import MM, Phrase
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.residual_model import PostureBasis
from cellctl.formats import DataSet, ModelFile, RobotFile, measurements
from cellctl.kinematics import Floats
from tests.helpers import arms
from tests.helpers.arms import csv_text, joints_and_places

ROBOT = RobotFile.model_validate(yaml.safe_load(arms.ELBOW_ROBOT))
ROWS = 120


@dataclass(frozen=True, eq=False)
class KrigingField(ResidualModel):
    """A smooth error of the height alone, over a few postures; it has a region of its own."""

    centres: Floats
    length: float = 0.6
    expected: float = 0.3
    basis: PostureBasis = field(init=False, repr=False)

    group: ClassVar = "kriged"
    title: ClassVar = "Kriging field"

    def __post_init__(self):
        object.__setattr__(self, "basis", PostureBasis(self.centres, self.length))

    @classmethod
    def of_inputs(cls, setup):
        return cls(setup.at.q[::8])

    @property
    def parameters(self):
        phrase = Phrase("kriging field", "kriging field")
        return tuple(
            Parameter(f"kriging{m + 1}", MM, self.group, f"kriging {m + 1}", phrase) for m in range(len(self.centres))
        )

    @property
    def sigma(self):
        return np.full(len(self.centres), self.expected)

    def shifts(self, nominal, at):
        return self.basis.values(at.q)[:, None, :] * np.array([0.0, 0.0, 1.0])[:, None]

    def variance(self, nominal, at):
        return self.expected**2 / 3.0 * self.basis.remainder(at.q)

    def outside(self, at):
        return self.basis.remainder(at.q)


class Certain(KrigingField):
    """The same, with nothing left open."""

    variance = ResidualModel.variance
    outside = ResidualModel.outside


@pytest.fixture
def model(monkeypatch):
    monkeypatch.setattr(effects, "EFFECTS", (*EFFECTS, KrigingField))
    rng = np.random.default_rng(4)
    readings = rng.uniform(arms.ELBOW_LOWER, arms.ELBOW_UPPER, (ROWS, 3))
    places = arms.ElbowArm().tcp(readings) + rng.normal(0.0, 0.01, (ROWS, 3))
    places[:, 2] += 0.2 * np.sin(2.0 * np.deg2rad(readings[:, 1]))
    data = DataSet.parse(csv_text(joints_and_places(readings, places)), "data.csv")
    measured = measurements(ROBOT, data, model="geometry+kriged")
    result = fit(measured.task, Split.by_column(np.arange(ROWS) >= 90))
    assert "kriged" in result.model.split("+")
    assert result.test.rms < 0.5 * result.nominal.rms
    return ModelFile.of(ROBOT, measured, result)


@pytest.fixture
def without(model, monkeypatch):
    """The same file, read where the field leaves nothing open."""
    monkeypatch.setattr(effects, "EFFECTS", (*EFFECTS, Certain))
    return ModelFile.model_validate_json(model.text())


BETWEEN = np.array([[0.0, 30.0, 60.0], [20.0, 40.0, 50.0], [-40.0, 20.0, 80.0], [60.0, 60.0, 40.0]])


def test_a_model_file_holds_it(model, tmp_path):
    path = tmp_path / "model.json"
    model.save(path)
    assert ModelFile.load(path).text() == path.read_text()


def test_sigma_of_a_prediction_has_what_it_leaves_open(model, without, monkeypatch):
    plain = without.predict(BETWEEN).sigma_mm, without.sigma(BETWEEN, kind="among")
    monkeypatch.setattr(effects, "EFFECTS", (*EFFECTS, KrigingField))
    own = model.robot_model().residual_models[-1]
    at = Postures(ROBOT.joint_map().model(BETWEEN))
    more = np.hypot(np.sqrt(3.0 * own.variance(model.robot_model().nominal, at)), _growth_of_region(model, at.q))
    assert more.min() > 0.005
    np.testing.assert_allclose(model.predict(BETWEEN).sigma_mm, np.hypot(plain[0], more), rtol=1e-9)
    np.testing.assert_allclose(model.sigma(BETWEEN, kind="among"), np.hypot(plain[1], more), rtol=1e-9)


def _growth_of_region(model, q):
    """What the field adds to σ outside its own region: it is further outside than the region's own postures are."""
    region = model.measured_region()
    bare = type(region)(**{**vars(region), "residual_models": ()})
    return np.sqrt(np.maximum(region.outside(q) ** 2 - bare.outside(q) ** 2, 0.0))


def test_the_measured_region_ends_where_it_says_so(model, without, monkeypatch):
    readings = np.random.default_rng(1).uniform(arms.ELBOW_LOWER, arms.ELBOW_UPPER, (400, 3))
    plain = without.inside(readings)
    monkeypatch.setattr(effects, "EFFECTS", (*EFFECTS, KrigingField))
    far = model.robot_model().outside(ROBOT.joint_map().model(readings)) > 0.5
    assert 0 < np.count_nonzero(far & plain) < 400
    np.testing.assert_array_equal(model.inside(readings), plain & ~far)
