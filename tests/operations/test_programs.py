"""KRL programs as motions, goals, compensated points and paths, against poses and robots by plain numpy.

The robot is the tests' own KR5, `kr5()`, and `TRUE` the same with errors of `kr5_model`. Points are written in the
base: a corner of a plate, and a half circle of radius 60 mm in the base's plane.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from cellctl.files import InputError
from cellctl.krl import KrlFile
from cellctl.operations.programs import CompensatedProgram, ProgramOptions, compensate_files, program_files
from cellctl.operations.programs._compensated import compensate_program
from cellctl.operations.programs._goals import ProgramGoals, ProgramRobots
from cellctl.operations.programs._krl import KrlProgram
from cellctl.operations.programs._krl_motions import KrlMotions
from cellctl.operations.programs._paths import program_paths, program_texts, with_points_between
from tests.helpers.arms import KR5_ERRORS, Floats, kr5_model
from tests.helpers.krl import TABLE, TORCH
from tests.helpers.own_model import kr5, pose_of, six_of, small_motion
from tests.helpers.simulated_setups import KR5_SIGNS

RADIUS = 60.0
ROBOTS = ProgramRobots(kr5_model())
TRUE = kr5().moved(list(KR5_ERRORS), list(KR5_ERRORS.values()))
START_Q = np.radians(KR5_SIGNS * np.array([-8.0, -55.0, 78.0, 14.0, 55.0, 25.0]))


def frame(numbers: tuple[float, ...] | Floats) -> Floats:
    """X, Y, Z, A, B, C (mm, deg) as a pose (4, 4)."""
    return small_motion(np.array([*numbers[:3], *np.radians(numbers[3:])]))


BASE = frame(TABLE)
CORNER = six_of(np.linalg.inv(BASE) @ kr5().poses(START_Q[None])[0])
CENTRE = CORNER[:3] + np.array([-80.0, 150.0, -40.0])


def at(place: Floats, turned_deg: float = 0.0) -> Floats:
    """X, Y, Z, A, B, C in the base, the tool as in the corner and turned about the base's z axis."""
    return np.concatenate([place, np.degrees(CORNER[3:]) + turned_deg * np.eye(3)[0]])


POINTS = {
    "P1": at(CORNER[:3]),
    "P2": at(CENTRE + RADIUS * np.eye(3)[0], 4.0),
    "P3": at(CENTRE + RADIUS * np.eye(3)[1], 4.0),
    "P4": at(CENTRE - RADIUS * np.eye(3)[0], 4.0),
}
MOTIONS = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\nPTP XP1\nLIN XP2\nCIRC XP3,XP4\n"


def aggregate(values: Floats | tuple[float, ...]) -> str:
    return "{" + ",".join(f"{label} {value:.9f}" for label, value in zip("XYZABC", values, strict=True)) + "}"


def program(motions: str = MOTIONS, *data: str, **stated: tuple[float, ...]) -> KrlProgram:
    points = [f"DECL E6POS X{name}={aggregate(values)}" for name, values in POINTS.items()]
    texts = {
        "part.src": f"DEF PART()\n{motions}END\n",
        "part.dat": "\n".join(["DEFDAT PART", *points, *data, "ENDDAT", ""]),
        "$config.dat": f"DEFDAT $CONFIG\nTOOL_DATA[1]={aggregate(TORCH)}\nBASE_DATA[2]={aggregate(TABLE)}\nENDDAT\n",
    }
    read = [KrlFile.parse(text.encode(), name) for name, text in texts.items()]
    return KrlProgram(KrlMotions(*read, **stated))


def compensated(motions: str = MOTIONS) -> CompensatedProgram:
    return compensate_program(program(motions), ROBOTS)


def wanted(name: str) -> Floats:
    return BASE @ frame(POINTS[name])


def real_places(sent: Floats) -> Floats:
    """TCPs (N, 3) of the true robot where a nominal controller goes to `sent` (N, 4, 4)."""
    return TRUE.points(kr5().held(sent, np.tile(START_Q, (len(sent), 1))))


def on_line(start: Floats, end: Floats, shares: Floats) -> Floats:
    """Poses (M, 4, 4) on a straight line, turning about one axis in proportion to the way."""
    turns = Slerp([0.0, 1.0], Rotation.from_matrix([start[:3, :3], end[:3, :3]]))(shares)
    places = start[:3, 3] + shares[:, None] * (end[:3, 3] - start[:3, 3])
    return np.stack([pose_of(turn, place) for turn, place in zip(turns, places, strict=True)])


def test_motions_have_their_kind_points_tool_and_base_and_a_start_where_it_is_certain() -> None:
    moves = program(MOTIONS + "SLIN XP1\n").moves
    found = [(each.kind, each.line, each.start) for each in moves]
    assert found == [("PTP", 4, None), ("LIN", 5, 0), ("CIRC", 6, 1), ("LIN", 7, 2)]
    assert [point.name for point in moves[2].uses] == ["XP3", "XP4"]
    assert {each.tool.numbers for each in moves} == {TORCH}
    assert {each.base.numbers for each in moves} == {TABLE}
    assert {(each.other_way, each.fault) for each in moves} == {("", "")}
    starts = {"WAIT SEC 1": 0, "PULSE($OUT[1],TRUE,0.1)": 0, "AGAIN:": None, "GRIPPER(1)": None, "LOOP\nENDLOOP": None}
    assert {each: program(f"PTP XP1\n{each}\nLIN XP2\n").moves[1].start for each in starts} == starts


def test_a_stated_tool_and_base_stand_for_those_of_the_program() -> None:
    stated = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    moves = program("PTP XP1\n", tool=stated, base=TABLE).moves
    assert (moves[0].tool.numbers, moves[0].tool.name, moves[0].base.numbers) == (stated, "--tool", TABLE)
    unknown = program("$TOOL=TOOL_DATA[9]\nPTP XP1\n").moves[0]
    assert unknown.tool.numbers is None
    assert "TOOL_DATA[9] is not defined in $config.dat" in unknown.tool.reason
    assert "its base is not certain" in unknown.base.reason
    assert program("$TOOL=TOOL_DATA[1]\nPTP XP1\n$TOOL=TOOL_DATA[4]\nPTP XP2\n").several("tool") == ["1", "4"]


def test_a_point_that_cannot_be_changed_for_certain_is_a_fault_of_its_motion() -> None:
    points = ["DECL GLOBAL E6POS XP5={X 1,Y 2,Z 3,A 0,B 0,C 0}", "DECL E6POS XP6={X 1,Y 2}"]
    faults = {
        "LIN_REL {X 10}": "the motion is relative",
        "CIRC XP3,XP4,CA ANGLE": "its circular angle is computed",
        "PTP XP9": "XP9 is not in these files",
        "PTP XP1:XP2": "the point is computed",
        "XP1.X=XP1.X+5\nPTP XP1": "XP1 is also used in line 2, not as the point of a motion",
        "PTP XP5": "XP5 is GLOBAL: other programs may use it",
        "PTP XP6": "XP6 has no Z, A, B, C",
        "PTP {X 1,Y 2,Z 3,A 0,B 0,C 0,E1 7}": "the point in line 2 moves the external axis E1",
    }
    assert {each: program(f"{each}\n", *points).moves[0].fault for each in faults} == faults


def test_the_orientation_in_force_is_that_of_the_last_assignment_or_ldat() -> None:
    data = "DECL LDAT LCP={VEL 2.0,ACC 100.0,ORI_TYP #JOINT,CIRC_TYP #PATH}"
    lines = ["LIN XP1", "$ORI_TYPE=#CONSTANT", "LIN XP1", "LDAT_ACT=LCP", "BAS(#CP_PARAMS,2)", "LIN XP1"]
    lines += ["BAS(#INITMOV,0)", "LIN XP1", "SLIN XP1 WITH $ORI_TYPE=#JOINT", "LIN XP1", "$ORI_TYPE=SOME()", "LIN XP1"]
    moves = program("\n".join([*lines, ""]), data).moves
    modes = ["", "#CONSTANT, #BASE", "#JOINT, #PATH", "", "#JOINT, #BASE", "", "not certain, #BASE"]
    assert [each.other_way.partition("here ")[2] for each in moves] == modes


def test_goals_are_base_times_point_and_their_joints_put_the_tool_there() -> None:
    found = ProgramGoals(program(), ROBOTS)
    by_name = {each.point.name: each for goals in found.goals.values() for each in goals}
    assert set(by_name) == {"XP1", "XP2", "XP3", "XP4"}
    for name, goal in by_name.items():
        assert goal.pose == pytest.approx(wanted(name[1:]), abs=1e-8)
        assert kr5().poses(goal.q[None])[0] == pytest.approx(goal.pose, abs=1e-5)
    assert by_name["XP3"].gives == "place", "the orientation of an auxiliary point is not used"
    line = found.segments[1].poses([0.25])[0]
    assert line == pytest.approx(on_line(wanted("P1"), wanted("P2"), np.array([0.25]))[0], abs=1e-8)


@pytest.mark.parametrize(("suffix", "angle_deg"), [("", 180.0), (",CA 90", 90.0), (",CA 270", 270.0)])
def test_the_wanted_way_of_a_circle_is_the_circle_through_its_points(suffix: str, angle_deg: float) -> None:
    motions = MOTIONS.replace("XP3,XP4", f"XP3,XP4{suffix}")
    arc = ProgramGoals(program(motions), ROBOTS).segments[2]
    for share in (0.0, 0.3, 1.0):
        angle = np.radians(share * angle_deg)
        place = CENTRE + RADIUS * np.array([np.cos(angle), np.sin(angle), 0.0])
        assert arc.poses([share])[0, :3, 3] == pytest.approx((BASE @ [*place, 1.0])[:3], abs=1e-7)


def test_points_that_one_change_cannot_suit_stay_with_the_reason() -> None:
    other = "$BASE=$NULLFRAME\nLIN XP2\n"
    found = ProgramGoals(program(MOTIONS + other), ROBOTS)
    assert [reason for reason in found.left.values() if "several bases" in reason] == [
        "used with several bases: BASE_DATA[2], BASE_NO 0"
    ]
    far = ProgramGoals(program(MOTIONS, tool=(*TORCH[:2], TORCH[2] + 0.5, *TORCH[3:])), ROBOTS)
    assert {reason.partition(";")[0] for reason in far.left.values()} == {
        "wrong tool: --tool is 0.50 mm and 0.00° from the tool of the model's robot file"
    }
    assert not far.goals


def test_with_the_new_numbers_the_true_robot_is_where_the_program_wanted_it() -> None:
    found = compensated()
    assert not found.left
    for each in found.changed.values():
        name = each.point.name[1:]
        assert each.point.position is not None
        old = dict(zip("XYZABC", each.point.position, strict=True))
        new = old | {label: float(text) for label, text in each.numbers.items()}
        sent = BASE @ frame([new[label] for label in "XYZABC"])
        if name == "P3":  # its orientation on the way is that of the circle's ends
            sent[:3, :3] = each.parts[0].sent[:3, :3]
        place = wanted(name)[:3, 3]
        off = float(np.linalg.norm(TRUE.points(each.parts[0].goal.q[None])[0] - place))
        assert off > 1.0
        assert each.before_mm == pytest.approx(off, abs=1e-5)
        assert np.linalg.norm(real_places(sent[None])[0] - place) < 1e-4
        assert each.after_mm < 1e-4
        assert each.correction_mm == pytest.approx(float(np.linalg.norm(sent[:3, 3] - place)), abs=1e-5)


def deviation(ends: list[Floats], first: float = 0.0, last: float = 1.0) -> float:
    """Largest distance, mm, of the true robot from the line P1–P2 between two shares, on a line between `ends`."""
    shares = np.linspace(0.0, 1.0, 41)
    way = on_line(wanted("P1"), wanted("P2"), first + (last - first) * shares)[:, :3, 3]
    return float(np.linalg.norm(real_places(on_line(*ends, shares)) - way, axis=1).max())


def test_the_deviation_of_a_line_is_bounded_before_and_after_and_inserted_points_reduce_it() -> None:
    found = compensated()
    line, circle = program_paths(found)
    assert (line.reason, circle.reason, line.remarks) == ("", "", ())
    sent = {each.point.name: each.parts[0].sent for each in found.changed.values()}
    new, old = [sent["XP1"], sent["XP2"]], [wanted("P1"), wanted("P2")]
    largest = deviation(new)
    assert 0.005 < largest <= line.bound_mm + 1e-6
    assert line.sampled_mm == pytest.approx(largest, rel=0.02)
    assert deviation(old) <= line.before_mm == pytest.approx(deviation(old), rel=0.1)
    parted = with_points_between(found, line, 0.4 * largest)
    assert with_points_between(found, line, 2.0 * line.bound_mm).between is None
    assert parted.between is not None
    assert parted.final_mm <= 0.4 * largest
    lines = program_texts(found, [parted, circle])["src"].decode().splitlines()
    places = [re.fullmatch(r"LIN \{(.*)\} C_DIS", text) for text in lines]
    inserted = [BASE @ frame([float(part.split()[1]) for part in place[1].split(",")]) for place in places if place]
    assert len(inserted) == len(parted.between.sent) - 1 >= 1
    stops = [new[0], *inserted, new[1]]
    for index, (first, last) in enumerate(zip(parted.between.shares, parted.between.shares[1:], strict=False)):
        assert deviation(stops[index : index + 2], first, last) <= parted.final_mm + 1e-4


def test_a_path_that_is_not_judged_has_its_reason() -> None:
    reasons = {
        "IF $IN[1] THEN\nENDIF\nLIN XP2": "its start is not certain",
        "$ORI_TYPE=#JOINT\nLIN XP2": "computed for orientation #VAR, #BASE only; here #JOINT, #BASE",
        "LIN XP9": "a point of it stays as it was",
        "SPL XP2": "a spline: the curve between its points is not computed",
    }
    assert {each: program_paths(compensated(MOTIONS.replace("LIN XP2", each)))[0].reason for each in reasons} == reasons


def test_compensated_files_have_the_figures_of_their_points_and_paths(tmp_path: Path) -> None:
    for file in program().read.parts.values():
        (tmp_path / file.name).write_bytes(file.data)
    files = program_files(tmp_path / "part.src", None)
    words = {"tool": ",".join(map(str, TORCH)), "base": ",".join(map(str, TABLE))}
    made = compensate_files(kr5_model(), "m.json", files, "pseudo-target", ProgramOptions(**words), None)
    figures = made.figures([tmp_path / "out.src"])
    goals = [each.parts[0].goal for each in made.program.changed.values()]
    before = [float(np.linalg.norm(goal.pose[:3, 3] - TRUE.points(goal.q[None])[0])) for goal in goals]
    assert [point.name for point in figures.points] == ["XP1", "XP2", "XP3", "XP4"]
    assert figures.before_mm["max"] == pytest.approx(max(before), abs=1e-5)
    assert figures.tool_shift_mm == pytest.approx(1.1, abs=1e-9), "the model's tool_y"
    assert [path.line for path in figures.paths] == [5, 6]
    with pytest.raises(InputError, match="is not X,Y,Z,A,B,C"):
        compensate_files(kr5_model(), "m.json", files, "pseudo-target", ProgramOptions(tool="1,2,nan,4,5,6"), None)
