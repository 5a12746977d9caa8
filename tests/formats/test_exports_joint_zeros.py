"""Joint zeros, tool and base for KUKA, ABB and FANUC: a controller that takes them reads where the arm is."""

import csv
import io
import json
import re

import numpy as np
import pytest

from cellctl.calibration.effects._backlash import Backlash
from cellctl.calibration.effects._compliance import JointCompliance
from cellctl.calibration.effects._thermal_expansion import ThermalExpansion
from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats.exports import Cost, abb_text, fanuc_text, joint_zeros, kuka_text, measured_postures
from cellctl.formats.load import LoadRegion
from cellctl.formats.table_making import nominal_chain
from cellctl.kinematics import abc_from_rotation, inverse_pose
from cellctl.krl._krl_file import KrlFile
from tests.helpers.arms import ROBOTS, by_axes, library_robot, model_of, perturbed
from tests.helpers.own_model import forward_of_robot_file, kuka_frame

ZEROS_DEG = [0.0, 0.31, -0.22, 0.4, -0.17, 0.0]
REGION = [[-60.0, -120.0, -20.0, -90.0, -80.0, -90.0], [60.0, -40.0, 100.0, 90.0, 80.0, 90.0]]


def with_zeros(name, angles_deg=ZEROS_DEG, **more):
    """A robot whose joint zeros (model angles) alone are off."""
    values = {f"theta{joint}": np.radians(angle) for joint, angle in enumerate(angles_deg, 1)}
    return model_of(library_robot(name), {**values, **more}, region=REGION)


def nominal_flange(name, readings):
    """By the tests' own kinematics: the flange in the base of the robot file as shipped (no tool, base 0)."""
    text = (ROBOTS / f"{name}.yaml").read_text()
    return forward_of_robot_file(re.sub(r"(?m)^tool:.*$", "", text), readings)


def krl_frames(text):
    """TOOL_DATA and BASE_DATA (4, 4) as a controller reads them."""
    found = re.findall(r"^(TOOL|BASE)_DATA\[\d+\]=\{X (\S+),Y (\S+),Z (\S+),A (\S+),B (\S+),C (\S+)\}$", text, re.M)
    return {name: kuka_frame({"xyz": [*map(float, row[:3])], "abc": [*map(float, row[3:])]}) for name, *row in found}


def krl_offsets(text):
    return [float(value) for value in re.findall(r"^; A\d\s+([-+]\d+\.\d+)", text, re.M)]


@pytest.mark.parametrize("name", ["kr5_r1400", "kr300_r2500"])
def test_the_controllers_readings_grow_by_the_zeros_in_the_sense_of_each_joint(name):
    """A1, A4 and A6 count against the model's angles."""
    zeros = joint_zeros(with_zeros(name))
    senses = [joint.sign for joint in library_robot(name).joints]
    np.testing.assert_allclose(zeros.offsets, np.multiply(senses, ZEROS_DEG), atol=1e-6)
    assert -1 in senses
    assert zeros.after.rms_mm < 1e-5
    assert zeros.before.rms_mm > 1.0


def test_a_kuka_with_these_offsets_tool_and_base_reads_the_place_that_the_arm_is_at():
    """The controller knows the nominal arm. At one posture its readings before and after differ by the offsets."""
    model = with_zeros("kr5_r1400", base_x=3.0, base_c=0.01, tool_y=-2.0, tool_a=0.02)
    text = kuka_text("KR5", joint_zeros(model), 3, 7)
    frames, offsets = krl_frames(text), krl_offsets(text)
    assert "TOOL_DATA[3]=" in text
    assert "BASE_DATA[7]=" in text
    for readings in np.random.default_rng(2).uniform(*REGION, (10, 6)):
        arm = model.robot_model().pose(model.robot.joint_map().model(readings))
        shown = inverse_pose(frames["BASE"]) @ nominal_flange("kr5_r1400", readings + offsets) @ frames["TOOL"]
        np.testing.assert_allclose(shown[:3, 3], arm[:3, 3], atol=2e-3)  # five decimals of a degree
        np.testing.assert_allclose(shown[:3, :3], arm[:3, :3], atol=1e-6)


def test_a_name_with_other_characters_or_lines_stays_one_comment_of_krl():
    zeros = joint_zeros(with_zeros("kr5_r1400"))
    text = kuka_text("Zelle für\nPrüfung", zeros, 1, 1)
    assert text.isascii()
    assert KrlFile.parse(text.encode(), "offsets.dat").unknown == ()
    assert {line[0] for line in text.splitlines()} == {";", "T", "B"}


@pytest.mark.long
def test_the_stated_distance_is_that_of_a_controller_with_the_nominal_arm():
    """All parameters of the chain are off: mastering cannot hold them, and what it leaves is stated."""
    model = perturbed(library_robot("kr5_r1400"), 8, 1e-3, 0.5)
    zeros = joint_zeros(model)
    frames, offsets = krl_frames(kuka_text("KR5", zeros, 1, 1)), zeros.offsets
    at = measured_postures(model)
    arm = model.robot_model().tcp(at)
    flanges = [nominal_flange("kr5_r1400", row + offsets) for row in model.robot.joint_map().readings(at.q)]
    shown = [(inverse_pose(frames["BASE"]) @ flange @ frames["TOOL"])[:3, 3] for flange in flanges]
    distances = np.linalg.norm(np.array(shown) - arm, axis=1)
    assert zeros.after.rms_mm == pytest.approx(float(np.sqrt(np.mean(distances**2))), rel=1e-3)
    assert zeros.after.max_mm == pytest.approx(distances.max(), rel=5e-3)
    assert zeros.after.rms_mm < zeros.before.rms_mm


def test_these_numbers_take_a_controller_to_the_targets_at_the_joints_of_write_back_zeros(tmp_path, monkeypatch):
    """`compensate --method write-back-zeros` and `convert --to kuka` write the same offsets, base and tool."""
    robot, load = library_robot("kr300_r2500"), LoadRegion(min=0.0, max=100.0, at=[0.0, 0.0, 200.0])
    amounts = {"compliance_load2": 1e-6, "compliance_load3": 1e-6, "backlash2": 2e-4, "theta2": 0.003, "a2": 0.8}
    model = model_of(robot, amounts, (JointCompliance(6, load_known=True), Backlash(6)), REGION)
    model.model_copy(update={"load_region": load}).save(tmp_path / "m.json")
    readings = np.array([[10.0, -70.0, 60.0, 20.0, 50.0, 30.0], [-20.0, -90.0, 80.0, -30.0, 60.0, -10.0]])
    targets = nominal_chain(model).forward(robot.joint_map().model(readings))
    rows = np.hstack([targets[:, :3, 3], abc_from_rotation(targets[:, :3, :3]), readings])
    header = "X,Y,Z,A,B,C,A1,A2,A3,A4,A5,A6"
    np.savetxt(tmp_path / "t.csv", rows, delimiter=",", header=header, comments="", fmt="%.12f")
    monkeypatch.chdir(tmp_path)
    app(["compensate", "m.json", "t.csv", "--method", "write-back-zeros", "-o", "joints.csv"], standalone_mode=False)
    app(["convert", "m.json", "--to", "kuka", "-o", "offsets.dat"], standalone_mode=False)
    text = (tmp_path / "offsets.dat").read_text()
    frames, offsets = krl_frames(text), np.array(krl_offsets(text))
    assert np.abs(offsets).max() > 0.1
    for target, row in zip(targets, csv.DictReader((tmp_path / "joints.csv").open()), strict=True):
        joints = np.array([float(row[f"A{axis}"]) for axis in range(1, 7)])
        flange = nominal_flange("kr300_r2500", joints + offsets)
        shown = inverse_pose(frames["BASE"]) @ flange @ frames["TOOL"]
        np.testing.assert_allclose(shown[:3, 3], target[:3, 3], atol=2e-3)  # five decimals of a degree
        np.testing.assert_allclose(shown[:3, :3], target[:3, :3], atol=1e-6)


def test_no_other_offsets_come_nearer():
    model = perturbed(library_robot("kr5_r1400"), 8, 1e-3, 0.5)
    zeros, at = joint_zeros(model), measured_postures(model)
    goal = model.robot_model().tcp(at)
    chain = model.robot.chain().with_base(zeros.base).with_tool(zeros.tool)
    turns = model.robot.joint_map().sign * np.radians(zeros.offsets)

    def rms(turned):
        apart = chain.forward(at.q + turned)[:, :3, 3] - goal
        return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))

    best = rms(turns)
    assert best == pytest.approx(zeros.after.rms_mm, rel=1e-9)
    for joint in range(1, 5):
        for step in (-1e-4, 1e-4):
            assert rms(turns + step * np.eye(6)[joint]) > best


class Counter:
    """One axis of a controller: it shows its motor's angle plus a constant that its calibration sets."""

    def __init__(self):
        self.constant = 0.0

    def shown(self, motor):
        return motor + self.constant

    def calibrate(self, motor, as_reading):
        self.constant = as_reading - motor


def test_fine_calibration_of_an_abb_at_the_stated_readings_shifts_each_axis_by_its_offset():
    zeros = joint_zeros(with_zeros("irb120"))
    rows = list(csv.DictReader(io.StringIO(abb_text(zeros))))
    assert [int(row["axis"]) for row in rows] == [1, 2, 3, 4, 5, 6]
    for row, offset in zip(rows, zeros.offsets, strict=True):
        axis = Counter()
        axis.calibrate(float(row["move_to_deg"]), 0.0)
        assert axis.shown(12.5) - 12.5 == pytest.approx(offset, abs=1e-5)
        assert float(row["offset_deg"]) == pytest.approx(offset, abs=1e-5)


def test_mastering_a_fanuc_at_zero_shifts_each_joint_by_its_offset_with_j3_shown_from_the_horizontal():
    """J3 as shown is J3 of the robot file less J2: so are its readings before and after."""
    zeros = joint_zeros(with_zeros("m10ia"))
    rows = list(csv.DictReader(io.StringIO(fanuc_text(zeros))))
    file_readings = np.array([10.0, 20.0, -30.0, 40.0, 50.0, 60.0])

    def as_shown(readings):
        return readings - [0.0, 0.0, readings[1], 0.0, 0.0, 0.0]

    wanted = as_shown(file_readings + zeros.offsets) - as_shown(file_readings)
    for row, shift in zip(rows, wanted, strict=True):
        joint = Counter()
        joint.calibrate(0.0, float(row["master_at_zero_deg"]))
        assert joint.shown(7.0) - 7.0 == pytest.approx(shift, abs=2e-5)
        assert float(row["shown_offset_deg"]) == pytest.approx(shift, abs=2e-5)


def test_a_model_by_axes_gives_the_same_offsets():
    values = {f"theta{joint}": np.radians(angle) for joint, angle in enumerate(ZEROS_DEG, 1)}
    robot = library_robot("kr5_r1400")
    one, other = (joint_zeros(model_of(each, values, region=REGION)) for each in (robot, by_axes(robot)))
    np.testing.assert_allclose(one.offsets, other.offsets, atol=1e-6)


def test_the_command_says_what_mastering_cannot_hold_and_what_it_costs(tmp_path, capsys):
    with_zeros("kr5_r1400").save(tmp_path / "m.json")
    words = ["convert", str(tmp_path / "m.json"), "--to", "kuka", "--json", str(tmp_path / "r.json"), "-o"]
    assert exit_codes.exit_code_of(lambda: app([*words, str(tmp_path / "k.dat")], standalone_mode=False)) == 0
    said = capsys.readouterr().err
    assert "left out, as this form has no place for it: lengths and axes of the links; without" in said
    assert "the TCP is off by 0.000 mm RMS" in said
    assert "the nominal robot, its base and tool registered, is off by" in said
    assert "warning" not in said
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["nominal"]["rms_mm"] > 1.0
    assert krl_offsets((tmp_path / "k.dat").read_text()) == pytest.approx(result["offsets_deg"], abs=1e-5)


def test_numbers_of_tool_and_base_are_refused_where_a_form_has_none(capsys):
    words = ["convert", "kr5_r1400", "--to", "urdf", "--tool-number", "3"]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == 2
    assert "--to kuka" in capsys.readouterr().err


@pytest.mark.parametrize("form", ["kuka", "abb", "fanuc"])
def test_a_robot_file_has_no_zeros_to_write(form, capsys):
    words = ["convert", "kr5_r1400", "--to", form]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == 2
    assert "is no model" in capsys.readouterr().err


def test_an_effect_without_a_place_is_named_and_its_distance_is_that_of_the_effect(tmp_path, capsys):
    """Backlash is counted at approaches from either side, though no condition is given."""
    robot = library_robot("kr5_r1400")
    play = model_of(robot, {f"backlash{joint}": 2e-4 for joint in range(1, 7)}, (Backlash(6),), REGION)
    play.save(tmp_path / "m.json")
    for form in ("urdf", "dh-csv", "poe"):
        assert (
            exit_codes.exit_code_of(
                lambda f=form: app(["convert", str(tmp_path / "m.json"), "--to", f], standalone_mode=False)
            )
            == 0
        )
        said = capsys.readouterr().err
        found = re.search(
            r"left out, .*backlash; without it the TCP is off by (\S+) mm RMS, (\S+) mm at most, over 300 postures",
            said,
        )
        assert found, said
    arms = robot.chain().with_base(play.robot_model().chain.base_now).with_tool(play.robot_model().chain.tool_now)
    jacobian = arms.tool_jacobian(measured_postures(play).q)[:, :3]
    by_hand = np.sqrt(np.mean(np.sum(jacobian**2, axis=(1, 2)))) * 2e-4
    assert float(found[1]) == pytest.approx(by_hand, rel=0.1)


def test_an_effect_whose_conditions_are_unknown_is_said_to_be_not_counted(tmp_path, capsys):
    """No temperature is given: the distance without thermal expansion would be 0."""
    effect = ThermalExpansion.of(library_robot("kr5_r1400").chain())
    name = effect.parameters[0].name
    model_of(library_robot("kr5_r1400"), {name: 1e-5}, (effect,), REGION).save(tmp_path / "m.json")
    words = ["convert", str(tmp_path / "m.json"), "--to", "urdf"]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == 0
    assert "thermal expansion is not in this distance: its conditions are unknown" in capsys.readouterr().err


def test_the_distance_is_that_under_the_payloads_of_the_fit(tmp_path):
    """A model that carried 0 to 100 kg sags by them; without payload nothing would be missing."""
    springs = JointCompliance(6, load_known=True)
    load = LoadRegion(min=0.0, max=100.0, at=[0.0, 0.0, 200.0])
    amounts = dict.fromkeys(("compliance_load2", "compliance_load3"), 1e-06)
    model = model_of(library_robot("kr300_r2500"), amounts, (springs,), REGION)

    def cost(each):
        arm, at = each.robot_model(), measured_postures(each)
        return Cost.of(arm.chain, at.q, arm.pose(at))

    unloaded, loaded = cost(model), cost(model.model_copy(update={"load_region": load}))
    assert unloaded.rms_mm < 1e-9
    assert 0.5 < loaded.rms_mm < 20.0
