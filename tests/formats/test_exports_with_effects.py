"""Geometry written for a model with effects: links, base and tool nearest to the whole model."""

import json

import numpy as np
import pytest

from cellctl.calibration.effects._backlash import Backlash
from cellctl.calibration.effects._compliance import JointCompliance
from cellctl.cli.verbs import app
from cellctl.formats.description import RobotDescription, robot_text
from cellctl.formats.exports import Cost, fitted_geometry, measured_postures
from cellctl.formats.table_making import nominal_chain
from tests.helpers.arms import library_robot, model_of
from tests.helpers.own_model import forward_of_dh_table, forward_of_robot_file, forward_of_urdf

REGION = [[-90.0, -120.0, 20.0, -160.0, -150.0, -90.0], [30.0, -40.0, 120.0, 0.0, -40.0, 60.0]]
NARROW = [[-10.0, -100.0, 60.0, -80.0, -100.0, -20.0], [10.0, -80.0, 80.0, -60.0, -80.0, 20.0]]


def sagging_ur10(region=REGION):
    """All parameters off by 0.3 mm and 0.5 mrad (1 σ), and joints 2 and 3 bent by up to a millimetre at the TCP."""
    robot, springs, rng = library_robot("ur10"), JointCompliance(6), np.random.default_rng(3)
    chain = robot.chain()
    sizes = np.where(chain.parameter_turns, 5e-4, 0.3) * rng.standard_normal(len(chain.parameters))
    bent = [each.name for each in springs.parameters if each.name.startswith(("compliance2", "compliance3"))]
    amounts = dict(zip(bent, (1e-3 * rng.standard_normal(len(bent))).tolist(), strict=True))
    return model_of(robot, {**dict(zip(chain.parameters, sizes.tolist(), strict=True)), **amounts}, (springs,), region)


def converted(model, form, folder, capsys):
    """The file, the result and the lines on stderr of `cellctl convert`."""
    model.save(folder / "m.json")
    words = ["convert", str(folder / "m.json"), "--to", form, "-o", str(folder / "out"), "--json", str(folder / "r")]
    app(words, standalone_mode=False)
    return (folder / "out").read_text(), json.loads((folder / "r").read_text()), capsys.readouterr().err


def tcp(text, form, readings):
    if form == "urdf":
        return forward_of_urdf(text, "tcp", np.radians(readings))[:3, 3]
    return (forward_of_dh_table if form == "dh-csv" else forward_of_robot_file)(text, readings)[:3, 3]


def rms(vectors):
    return float(np.sqrt(np.mean(np.sum(np.square(vectors), axis=1))))


@pytest.mark.long
@pytest.mark.parametrize("form", ["urdf", "dh-csv", "mdh-hayati", "dh-craig", "poe"])
def test_the_written_geometry_is_nearer_to_the_whole_model_than_the_identified_one_and_nominal(form, tmp_path, capsys):
    """At other postures of the measured region than those of its fit, and as near at these as stderr states."""
    model = sagging_ur10()
    text, result, said = converted(model, form, tmp_path, capsys)
    real, joints, at = model.robot_model(), model.robot.joint_map(), measured_postures(model)
    there = rms(real.tcp(at) - [tcp(text, form, row) for row in joints.readings(at.q)])
    assert result["cost"]["rms_mm"] == pytest.approx(there, abs=1e-6)
    assert f"the TCP is off by {there:.3f} mm RMS" in said
    assert f"the nominal robot, its base and tool registered, is off by {result['nominal']['rms_mm']:.3f} mm" in said
    assert "warning" not in said
    other = np.random.default_rng(8).uniform(*REGION, (100, 6))
    q = joints.model(other)
    written = rms(real.tcp(q) - [tcp(text, form, row) for row in other])
    identified = rms(real.tcp(q) - real.chain.forward(q)[:, :3, 3])
    assert identified > 0.5
    assert written < 0.5 * identified
    assert written < 0.7 * result["nominal"]["rms_mm"]


@pytest.mark.parametrize("region", [REGION, NARROW])
def test_no_parameter_grows_where_axes_are_almost_parallel(region):
    """Joints 2, 3 and 4 of a UR: in a narrow region their parameters hardly differ in effect."""
    model = sagging_ur10(region)
    form, known = fitted_geometry(model), model.robot_model().chain
    moved, turns = np.abs(form.chain.deviations - known.deviations), known.parameter_turns
    assert moved[~turns].max() < 5.0
    assert moved[turns].max() < 0.005
    at = measured_postures(model)
    assert form.cost.rms_mm < Cost.of(known, at.q, model.robot_model().pose(at)).rms_mm
    assert form.cost.rms_mm < form.nominal.rms_mm


def test_a_ur_calibration_of_a_sagging_robot_has_numbers_near_the_makers(tmp_path, capsys):
    text, result, said = converted(sagging_ur10(), "ur-calibration", tmp_path, capsys)
    assert "links, base and tool are fitted to the whole model" in said
    assert result["better_than_nominal"] is True
    lengths = [float(line.split()[1]) for line in text.splitlines() if line.split()[0] in ("x:", "y:", "z:")]
    assert len(lengths) == 18
    assert max(map(abs, lengths)) < 0.65  # m: the upper arm has 0.612


@pytest.mark.parametrize("effects", [(), (JointCompliance(6),)])
def test_a_model_without_amounts_of_effects_is_written_as_identified(effects, tmp_path, capsys):
    model = model_of(library_robot("ur10"), {"theta2": 1e-3, "a2": 0.7, "alpha3": -2e-4, "base_b": 1e-4}, effects)
    text, result, said = converted(model, "mdh-hayati", tmp_path, capsys)
    identified = RobotDescription.of(model.robot, model.robot_model().chain)
    assert text == robot_text(identified, "mdh-hayati", str(tmp_path / "m.json"))
    assert result["cost"] is None
    assert said == ""


def test_a_form_that_is_not_better_than_nominal_warns(tmp_path, capsys):
    """Backlash depends on the side of approach: no geometry can take it over."""
    robot = library_robot("kr5_r1400")
    model = model_of(robot, {f"backlash{joint}": 2e-4 for joint in range(1, 7)}, (Backlash(6),), REGION)
    for form in ("urdf", "kuka"):
        _, result, said = converted(model, form, tmp_path, capsys)
        assert "warning: not better than nominal, at postures that were held out of its fit: " in said
        assert result["better_than_nominal"] is False
        assert result["held_out_rms_mm"] > result["nominal_held_out_rms_mm"]
    nominal = Cost.of(nominal_chain(model), (at := measured_postures(model)).q, model.robot_model().pose(at))
    assert result["nominal"]["rms_mm"] == pytest.approx(nominal.rms_mm, rel=0.05)
