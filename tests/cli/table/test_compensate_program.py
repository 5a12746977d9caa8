"""`cellctl compensate MODEL program.src`: what changes in a program, what stays, and that the robot is right then."""

import json
import re

import numpy as np
import pytest

from cellctl.formats import ModelFile
from cellctl.kinematics import abc_from_rotation, inverse, inverse_pose, pose_from_xyz_abc
from tests.helpers.arms import kr5_model
from tests.helpers.krl import (
    BASE,
    CHAIN,
    CORNER,
    JOINTS,
    TORCH,
    Seam,
    components,
    config,
    joints,
    position,
    readings_at,
    usual_seam,
)

CELL = "sphere_cell"


@pytest.fixture
def compensated(cellctl, folder):
    """Runs the command for seam.src with `$config.dat`; the figures of `--json`, and the files that it wrote."""

    def run(seam=None, *options, model=None, **how):
        (seam or usual_seam()).write(folder, **how)
        (model or kr5_model()).save(folder / "model.json")
        (folder / "out").mkdir(exist_ok=True)
        command = ("compensate", "model.json", "seam.src", "--config", "$config.dat", "-o", "out", "--json", "all.json")
        code = cellctl(*command, *options)
        figures = json.loads((folder / "all.json").read_text())
        assert code == (1 if figures["left"] else 0), "places that are not compensated show in the exit code"
        return figures

    return run


@pytest.fixture
def refused(cellctl, folder, capsys):
    """Runs the command, which must refuse; what it says."""

    def run(seam, *options, model=None):
        seam.write(folder)
        (model or kr5_model()).save(folder / "model.json")
        (folder / "out").mkdir(exist_ok=True)
        capsys.readouterr()
        assert cellctl("compensate", "model.json", "seam.src", "-o", "out", *options) == 2
        assert not list((folder / "out").iterdir())
        return " ".join(capsys.readouterr().err.split())

    return run


def left(figures):
    """Reason by name of what stayed."""
    return {one["name"]: one["reason"] for one in figures["left"]}


def aggregate(text, name):
    """The components of a point in a data list, read here without the project's reader."""
    body = re.search(rf"\b{name}=\{{(?:\w+:)?([^}}]*)\}}", text)[1]
    return {label: float(value) for label, value in (part.split() for part in body.split(","))}


def sent(values, base=BASE):
    """Pose in the robot's base frame of a point's components."""
    return base @ pose_from_xyz_abc([values[name] for name in "XYZ"], [values[name] for name in "ABC"])


def real_place(model, pose, near):
    """TCP of the identified robot, its base on the robot's, where a nominal controller is sent to `pose`."""
    q = inverse(CHAIN, pose, JOINTS.model(near))
    assert q.converged
    found = model.robot_model()
    return (inverse_pose(found.chain.base_now) @ found.pose(q.q))[:3, 3]


# what changes


def test_the_identified_robot_goes_where_the_program_wanted_it(compensated, folder):
    compensated()
    before, after = ((folder / name).read_text("latin-1") for name in ("seam.dat", "out/seam.dat"))
    for name in ("XP1", "XP2", "XP4", "XP5"):
        wanted, new = sent(aggregate(before, name)), sent(aggregate(after, name))
        assert np.linalg.norm(real_place(kr5_model(), wanted, CORNER) - wanted[:3, 3]) > 1.0
        assert np.linalg.norm(real_place(kr5_model(), new, CORNER) - wanted[:3, 3]) < 1e-4


def test_only_the_numbers_of_compensated_points_change(compensated, folder):
    seam = usual_seam()
    seam.dat.insert(0, ";  Schweißnaht für Tür\t links")
    seam.dat[1] = seam.dat[1].replace("={X ", " = { X\t").replace("DECL", "decl")
    compensated(seam, end="\r\n")
    numbers = rb"[-+]?\d+\.\d+"
    for name in ("seam.src", "seam.dat"):
        old, new = (folder / name).read_bytes(), (folder / "out" / name).read_bytes()
        assert re.sub(numbers, b"0", old) == re.sub(numbers, b"0", new)
    assert (folder / "out" / "seam.src").read_bytes() == (folder / "seam.src").read_bytes()
    changed = [line for line in zip(old.split(b"\r\n"), new.split(b"\r\n"), strict=True) if line[0] != line[1]]
    assert len(changed) == 5


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_tabs_umlauts_and_a_missing_end_are_no_obstacle(compensated, folder, end):
    seam = usual_seam()
    seam.src.insert(0, "\t; Größe prüfen\t")
    figures = compensated(seam, end=end, finish=False)
    assert figures["compensated"] == 5
    assert (folder / "out" / "seam.src").read_bytes() == (folder / "seam.src").read_bytes()


def test_joint_points_get_compensated_joints(compensated, folder):
    seam = Seam()
    seam.point("P1", joints(CORNER), kind="E6AXIS")
    seam.form("PTP", "P1")
    compensated(seam)
    values = aggregate((folder / "out" / "seam.dat").read_text(), "XP1")
    q = JOINTS.model([values[f"A{axis}"] for axis in range(1, 7)])
    wanted = CHAIN.forward(JOINTS.model(CORNER))
    found = kr5_model().robot_model()
    assert (
        np.linalg.norm(found.tcp(q) - wanted[:3, 3])
        < 1e-4
        < 1.0
        < np.linalg.norm(found.tcp(JOINTS.model(CORNER)) - wanted[:3, 3])
    )


def test_points_written_in_the_motion_are_changed_there(compensated, folder):
    seam = Seam()
    frame = f"{{{components(TORCH)}}}"
    seam.src = [
        f"$TOOL={frame}",
        "$BASE = BASE_DATA[2]",
        f"PTP {{{position(CORNER)}}}",
        f"\tLIN {{POS: {position(readings_at((0, 100, 0)))}}} C_DIS ; Ende",
    ]
    figures = compensated(seam)
    assert figures["compensated"] == 2
    assert [path["reason"] for path in figures["paths"]] == [""]
    text = (folder / "out" / "seam.src").read_text()
    assert frame in text
    for line, readings in (("PTP {", CORNER), ("LIN {POS: ", readings_at((0, 100, 0)))):
        new = sent(aggregate("P={" + text.split(line)[1].split("}")[0] + "}", "P"))
        goal = CHAIN.forward(JOINTS.model(readings))[:3, 3]
        assert np.linalg.norm(real_place(kr5_model(), new, readings) - goal) < 1e-4


def test_status_and_turn_choose_the_posture(compensated, folder):
    """The same position in two postures of the wrist has two corrections."""
    other = CORNER + np.array([0.0, 0.0, 0.0, 180.0, 0.0, 180.0])
    other[4] = -other[4]
    model = kr5_model()
    wide = model.joint_region.model_copy(update={"min": [-185.0] * 6, "max": [225.0] * 6, "postures": None})
    corrections = []
    for readings in (CORNER, other - np.array([0, 0, 0, 0, 0, 360.0])):
        np.testing.assert_allclose(
            CHAIN.forward(JOINTS.model(readings)), CHAIN.forward(JOINTS.model(CORNER)), atol=1e-6
        )
        seam = Seam()
        seam.point("P1", position(readings))
        seam.form("PTP", "P1")
        compensated(seam, model=model.model_copy(update={"joint_region": wide}))
        new = sent(aggregate((folder / "out" / "seam.dat").read_text(), "XP1"))
        wanted = CHAIN.forward(JOINTS.model(CORNER))[:3, 3]
        assert np.linalg.norm(real_place(model, new, readings) - wanted) < 1e-4
        corrections.append(new[:3, 3] - wanted)
    assert np.linalg.norm(corrections[0] - corrections[1]) > 0.1


def test_a_joint_that_crosses_zero_changes_the_turn_and_is_named(compensated, folder, capsys):
    at_zero = CORNER.copy()
    at_zero[0] = 0.01
    seam = Seam()
    seam.point("P1", position(at_zero))
    seam.form("PTP", "P1")
    figures = compensated(seam, model=kr5_model(errors={"tool_y": -1.5}))
    old, new = (aggregate((folder / name).read_text(), "XP1") for name in ("seam.dat", "out/seam.dat"))
    assert figures["points"][0]["turn"] == [old["T"], new["T"]]
    assert new["T"] - old["T"] == 1
    assert "T 2 becomes 3" in capsys.readouterr().out


def test_every_method_gives_the_same_points(compensated, folder):
    points = []
    for method in ("pseudo-target", "pseudo-target-matrix", "veitschegger-wu", "newton-raphson"):
        compensated(None, "--method", method)
        points.append(aggregate((folder / "out" / "seam.dat").read_text("latin-1"), "XP2"))
    for each in points[1:]:
        assert each == pytest.approx(points[0], abs=5e-6)


# paths


def test_the_deviation_on_lines_and_circles_is_reported(compensated, capsys):
    figures = compensated()
    assert [path["kind"] for path in figures["paths"]] == ["LIN", "CIRC", "LIN"]
    for path in figures["paths"]:
        assert 0.001 < path["largest_sample_mm"] <= path["bound_mm"] < 0.5 < path["before_mm"]
    assert "Between the points, 3 LIN and CIRC" in capsys.readouterr().out


def test_inserted_points_bring_the_path_into_the_tolerance(compensated, folder):
    figures = compensated(None, "--insert", "--path-tolerance", "0.005")
    assert all(path["bound_mm"] <= 0.005 for path in figures["paths"])
    assert all(path["undivided_mm"] > 0.005 for path in figures["paths"] if path["inserted"])
    old, new = ((folder / name).read_bytes().split(b"\r\n") for name in ("seam.src", "out/seam.src"))
    added = [line for line in new if line not in old]
    comments = [line for line in added if line.startswith(b"; cellctl: ")]
    motions = [line for line in added if re.fullmatch(rb"(LIN|CIRC) \{.*\} C_DIS", line)]
    assert len(comments) == sum(path["inserted"] > 0 for path in figures["paths"]) >= 2
    assert len(motions) == sum(path["inserted"] for path in figures["paths"])
    assert [line for line in new if line in old] == [line for line in old if line != b"CIRC XP3, XP4"]
    model = kr5_model()  # an inserted point of the line lies on the wanted line
    first = next(line for line in motions if line.startswith(b"LIN"))
    place = real_place(model, sent(aggregate(first.decode().replace("LIN ", "P="), "P")), CORNER)
    start, end = (CHAIN.forward(JOINTS.model(readings_at(shift)))[:3, 3] for shift in ((0, 0, 0), (-20, 150, -40)))
    along = (end - start) / np.linalg.norm(end - start)
    assert np.linalg.norm(np.cross(place - start, along)) < 1e-3


def test_a_circle_with_a_circular_angle_ends_where_it_shall(compensated, folder):
    seam = usual_seam()
    seam.src = [line.replace("CIRC XP3, XP4", "CIRC XP3, XP4, CA 120") for line in seam.src]
    figures = compensated(seam)
    assert figures["compensated"] == 5
    assert [path["reason"] for path in figures["paths"]] == ["", "", ""]
    assert max(path["bound_mm"] for path in figures["paths"]) < 0.5


def test_spline_motions_with_their_settings_are_compensated_and_divided(compensated, folder):
    seam = usual_seam()
    settings = (
        "WITH $VEL=SVEL_CP(0.1, , LCPDAT1), $TOOL=STOOL2(FP2), $BASE=SBASE(FP2.BASE_NO), "
        "$IPO_MODE=SIPO_MODE(FP2.IPO_FRAME), $ORI_TYPE=SORI_TYP(LCPDAT1) C_SPL"
    )
    seam.src = [*seam.src[:6], f"  SLIN XP2 {settings}"]
    figures = compensated(seam, "--insert", "--path-tolerance", "0.005")
    assert figures["compensated"] == 2
    assert figures["paths"][0]["bound_mm"] <= 0.005 < figures["paths"][0]["undivided_mm"]
    lines = (folder / "out" / "seam.src").read_text().splitlines()
    inserted = [line for line in lines if re.fullmatch(rf"  SLIN \{{X .*\}} {re.escape(settings)}", line)]
    assert len(inserted) == figures["paths"][0]["inserted"]


def test_points_of_a_fixed_tool_and_circles_that_are_none_stay(compensated):
    seam = usual_seam()
    seam.point("P6", position(readings_at((0, 50, 0))))
    seam.dat[-1] = seam.dat[-1].replace("#BASE", "#TCP")
    seam.form("PTP", "P6")
    for number, shift in enumerate([(0, 0, 0), (0, 40, 0), (0, 80, 0)], 7):
        seam.point(f"P{number}", position(readings_at(shift)))
    seam.form("PTP", "P7")
    seam.form("CIRC", "P8", "P9")
    found = left(compensated(seam))
    assert found["XP6"] == "its tool is fixed in the cell (#TCP)"
    assert "determine no circle" in found["XP8"]
    assert "determine no circle" in found["XP9"]


def test_inline_forms_with_collision_detection_are_judged_and_calls_of_others_are_not(compensated):
    seam = usual_seam()
    seam.src.insert(seam.src.index("LIN XP2"), "SET_CD_PARAMS (0)")
    seam.src.insert(len(seam.src) - 6, "GRIPPER(1)")
    figures = compensated(seam)
    assert figures["compensated"] == 5
    assert [path["reason"] for path in figures["paths"]] == ["", "", "its start is not certain"]


# what stays


def test_the_home_position_of_the_configuration_stays_and_is_named(compensated):
    seam = usual_seam()
    seam.src.insert(0, "PTP XHOME")
    figures = compensated(seam)
    assert figures["compensated"] == 5
    assert [(one["line"], one["reason"]) for one in figures["left"]] == [(6, "XHOME is not in these files")]


def test_points_that_the_program_uses_otherwise_stay(compensated, folder):
    seam, used = usual_seam(), []
    for number, line in enumerate(
        ["LIN {}:OFFSET", "{}.Z=10+{}.Z", "{} = XP9", "PICK({})", "IF {}.X > 5 THEN", "ENDIF", "{} ?? 5"], 10
    ):
        name = f"P{number}"
        seam.point(name, position(readings_at((0, 50, 0))))
        seam.form("PTP", name)
        seam.src.append(line.replace("{}", f"X{name}"))
        used += [f"X{name}"] if "{}" in line else []
    figures = compensated(seam)
    reasons = [one["reason"] for one in figures["left"]]
    old, new = ((folder / name).read_text() for name in ("seam.dat", "out/seam.dat"))
    for name in used:
        assert sum(f"{name} is also used in line" in reason for reason in reasons) == 1
        assert aggregate(old, name) == aggregate(new, name)


def test_a_line_that_is_not_understood_is_named(compensated):
    seam = usual_seam()
    seam.src.append("LIN XP1 XP2 ?")
    assert any(one["line"] == 30 and "not understood" in one["reason"] for one in compensated(seam)["left"])


def test_a_tool_that_the_given_configuration_lacks_is_missed_there(compensated):
    seam = usual_seam()
    seam.point("P6", position(readings_at((0, 50, 0))))
    seam.dat.append('DECL FDAT FOTHER={TOOL_NO 9,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}')
    seam.form("PTP", "P6", fdat="FOTHER")
    assert "TOOL_DATA[9] is not defined in $config.dat: define it there" in left(compensated(seam))["XP6"]


def test_a_point_in_two_bases_stays_and_the_last_line_says_how_many(compensated, capsys):
    seam = usual_seam()
    seam.point("P6", position(readings_at((0, 50, 0))))
    seam.dat.append('DECL FDAT FOTHER={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}')
    seam.form("PTP", "P6")
    seam.form("PTP", "P6", fdat="FOTHER")
    assert "used with several bases" in left(compensated(seam))["XP6"]
    assert "seam.src: 1 place is not compensated: it stays as in the program" in capsys.readouterr().err


def test_points_that_cannot_be_compensated_stay_with_their_reason(compensated):
    changes = {
        "external axis E1": lambda point: point.replace("E1 0.0", "E1 12.5"),
        "out of the robot's reach": lambda point: point.replace("X ", "X 9"),
        "are of no posture within the joint limits": lambda point: re.sub(r"S \d", "S 6", point),
        "GLOBAL": lambda point: point.replace("DECL E6POS", "DECL GLOBAL E6POS"),
        "has no Z": lambda point: re.sub(r"Z [-\d.]+,", "", point),
        "XP15 is not in these files": lambda point: point.replace("XP15", "XQ15"),
        "is given 2 times": lambda point: f"{point}\r\n{point}",
    }
    seam = usual_seam()
    for number, change in enumerate(changes.values(), 10):
        seam.point(f"P{number}", position(readings_at((0, 50, 0))))
        seam.dat[-2] = change(seam.dat[-2])
        seam.form("PTP", f"P{number}")
    figures = compensated(seam)
    assert figures["compensated"] == 5
    for reason in changes:
        assert sum(reason in one["reason"] for one in figures["left"]) == 1, reason


def test_a_status_that_the_line_does_not_arrive_in_is_named(compensated):
    seam = usual_seam()
    at = next(number for number, line in enumerate(seam.dat) if "XP2=" in line)
    seam.dat[at] = re.sub(r"S \d", "S 6", seam.dat[at])
    assert "S 6 is not the posture in which LIN or CIRC arrives" in left(compensated(seam))["XP2"]


def test_a_point_outside_the_measured_region_stays(compensated):
    seam = usual_seam()
    far = CORNER + np.array([45.0, 0, 0, 0, 0, 0])
    seam.point("P6", position(far))
    seam.form("PTP", "P6")
    figures = compensated(seam)
    assert figures["compensated"] == 5
    assert "A1 37.000° is not within -32…32°: outside the measured region" in left(figures)["XP6"]


def test_a_point_at_a_singularity_stays(compensated):
    seam = usual_seam()
    seam.point("P6", joints(np.array([0.0, -60.0, 80.0, 0.0, 0.5, 0.0])), kind="E6AXIS")
    seam.form("PTP", "P6")
    model = kr5_model()
    region = model.joint_region.model_copy(update={"min": [-90.0] * 6, "max": [120.0] * 6})
    assert "singularity" in left(compensated(seam, model=model.model_copy(update={"joint_region": region})))["XP6"]


def test_a_correction_over_the_limit_stays(refused):
    words = refused(usual_seam(), "--config", "$config.dat", model=kr5_model(errors={"theta2": 0.05}))
    assert "would be corrected by" in words
    assert "more than 2°" in words


def test_a_wrong_tool_stays_and_all_points_wrong_refuse_the_program(compensated, refused):
    seam = usual_seam()
    seam.point("P6", position(readings_at((0, 50, 0))), tool=2)
    seam.form("PTP", "P6")
    assert "wrong tool: TOOL_DATA[2]" in left(compensated(seam))["XP6"]


def test_a_tool_changed_after_the_model_refuses_the_program(cellctl, folder, capsys):
    usual_seam().write(folder)
    (folder / "$config.dat").write_text(config(torch=(60.5, *TORCH[1:])))
    assert cellctl("compensate", "model.json", "seam.src", "--config", "$config.dat") == 2
    words = " ".join(capsys.readouterr().err.split())
    assert "wrong tool: TOOL_DATA[1] is 0.60 mm" in words
    assert "the tool was changed after the model" in words
    assert "no point was compensated" in words


def test_a_model_of_a_reflector_elsewhere_does_not_move_the_tool(refused):
    model = kr5_model()
    reflector = pose_from_xyz_abc([120.0, 0.0, 80.0], [0.0, 0.0, 0.0]).tolist()
    elsewhere = model.model_copy(update={"start": {"base": model.start["base"], "tool": reflector}})
    words = refused(usual_seam(), "--config", "$config.dat", model=elsewhere)
    assert "the model was identified with a tool 340 mm and 39° from" in words
    assert "--arm-only" in words


def test_the_instruments_frame_does_not_matter(compensated, folder):
    texts = []
    for base in (np.eye(4), pose_from_xyz_abc([3400.0, -1200.0, 900.0], [150.0, 2.0, -3.0])):
        model = kr5_model()
        start = {"base": base.tolist(), "tool": model.start["tool"]}
        compensated(model=model.model_copy(update={"start": start}))
        texts.append((folder / "out" / "seam.dat").read_text("latin-1"))
    first, second = (aggregate(text, "XP2") for text in texts)
    assert first == pytest.approx(second, abs=2e-6)


def test_for_another_tool_the_arm_alone_is_corrected_where_asked(compensated, folder):
    seam = Seam()
    seam.point("P1", position(CORNER), tool=2, base=0)
    seam.form("PTP", "P1")
    gripper = CHAIN.with_tool(pose_from_xyz_abc([0, 0, 300], [0, 0, 0]))
    pose = gripper.forward(JOINTS.model(CORNER))
    numbers = components(np.array([*pose[:3, 3], *abc_from_rotation(pose[:3, :3])]))
    seam.dat[0] = re.sub(r"X .*?,S", f"{numbers},S", seam.dat[0])
    compensated(seam, "--arm-only")
    new = sent(aggregate((folder / "out" / "seam.dat").read_text(), "XP1"), np.eye(4))
    q = inverse(gripper, new, JOINTS.model(CORNER)).q
    arm = kr5_model().robot_model().chain
    assert np.linalg.norm((arm.forward_flange(q) @ gripper.tool)[:3, 3] - pose[:3, 3]) < 1e-3


def test_unknown_frames_are_named_with_the_cure(refused):
    words = refused(usual_seam())
    assert "TOOL_DATA[1] is not known: give --config '$config.dat', or --tool" in words


def test_tool_and_base_can_be_stated(cellctl, folder):
    usual_seam().write(folder)
    stated = [",".join(str(value) for value in frame) for frame in (TORCH, (900.0, -100.0, 200.0, 10.0, 5.0, -3.0))]
    command = ("compensate", "model.json", "seam.src", "--json", "all.json")
    assert cellctl(*command, "--tool", stated[0], "--base", stated[1]) == 0
    assert json.loads((folder / "all.json").read_text())["compensated"] == 5


@pytest.mark.parametrize("text", ["1,2,3", "1,2,3,4,5,x", "1,2,3,4,5,nan"])
def test_a_frame_that_is_none_is_refused(refused, text):
    assert f"'{text}' is not X,Y,Z,A,B,C" in refused(usual_seam(), "--tool", text)


# the command


def test_a_model_of_another_robot_is_refused(refused):
    model = kr5_model()
    other = model.model_copy(update={"robot": model.robot.model_copy(update={"name": "KUKA KR6 R900"})})
    words = refused(usual_seam(), "--config", "$config.dat", "--cell", CELL, model=other)
    assert "KR6 R900" in words


def test_the_input_is_never_written_over(cellctl, folder, capsys):
    usual_seam().write(folder)
    before = (folder / "seam.dat").read_bytes()
    for out in (".", "seam.src"):
        assert cellctl("compensate", "model.json", "seam.src", "--config", "$config.dat", "-o", out) == 2
        assert "written over" in capsys.readouterr().err
    assert (folder / "seam.dat").read_bytes() == before


def test_output_can_be_named(cellctl, folder):
    usual_seam().write(folder)
    assert cellctl("compensate", "model.json", "seam.src", "--config", "$config.dat", "-o", "new.src") == 0
    assert (folder / "new.src").exists()
    assert (folder / "new.dat").exists()


def test_the_output_says_which_points_must_not_be_compensated(compensated, capsys):
    compensated()
    said = capsys.readouterr().out
    assert "Points taught by hand with this robot contain its error already" in said
    assert "The identified tool is 1.100 mm from the taught one" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("seam.dat",), "is not a KRL program"),
        (("nothing.src",), "there is no such file"),
        (("seam.src", "--method", "all"), "'all' is not for programs"),
        (("seam.src", "--method", "newton"), "'newton' is not for programs"),
        (("seam.src", "--serial", "1"), "is not for programs"),
        (("targets.csv", "--serial", "1", "--insert"), "is for programs"),
        (("seam.src", "-o", "nowhere/x.txt"), "neither a folder nor a .src file"),
    ],
)
def test_wrong_calls_are_refused(cellctl, folder, capsys, words, message):
    usual_seam().write(folder)
    assert cellctl("compensate", "model.json", *words) == 2
    assert message in capsys.readouterr().err


def test_the_output_folder_is_made_only_where_something_is_written(cellctl, folder):
    usual_seam().write(folder)
    command = ("compensate", "model.json", "seam.src", "-o", "compensated")
    assert cellctl(*command) == 2  # no tool data
    assert not (folder / "compensated").exists()
    assert cellctl(*command, "--config", "$config.dat") == 0
    assert {path.name for path in (folder / "compensated").iterdir()} == {"seam.src", "seam.dat"}


def test_the_identified_robot_is_made_once_for_a_tool_not_for_each_point(compensated, monkeypatch):
    kr5_model().robot_model()
    calls, made = [], ModelFile.robot_model
    monkeypatch.setattr(ModelFile, "robot_model", lambda model: calls.append(1) or made(model))
    compensated()
    assert len(calls) <= 5


def test_the_same_files_give_the_same_bytes(compensated, folder):
    compensated(None, "--insert")
    first = (folder / "out" / "seam.src").read_bytes(), (folder / "out" / "seam.dat").read_bytes()
    compensated(None, "--insert")
    assert first == ((folder / "out" / "seam.src").read_bytes(), (folder / "out" / "seam.dat").read_bytes())
