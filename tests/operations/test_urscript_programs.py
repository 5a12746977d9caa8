"""URScript programs as motions and compensated points, against poses and robots by plain numpy.

The robot is a UR10e as its maker calibrated it; `MODEL` is the same with errors in three joint zeros and two lengths.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.files import InputError
from cellctl.formats import ModelFile
from cellctl.kinematics import Floats, inverse
from cellctl.operations.programs import CompensatedFiles, ProgramOptions, compensate_files, program_files
from cellctl.operations.programs._language import Move
from tests.helpers.ur import CHAIN, CORNER, HOME, MODEL, SET_TCP, SHEET, TOOL_MM, model, p, pose_at, q, shifted

TRUE = MODEL.robot_model()


def compensated(
    folder: Path, body: str, found: ModelFile = MODEL, *, whole: bool = False, **options: str | bool
) -> CompensatedFiles:
    text = body if whole else f"def part():\n{SET_TCP}{body}end\n"
    (folder / "part.script").write_bytes(text.encode())
    files = program_files(folder / "part.script", None)
    return compensate_files(found, "model.json", files, "pseudo-target", ProgramOptions(**options), None)


def moves(folder: Path, body: str, *, whole: bool = False) -> tuple[Move, ...]:
    text = body if whole else f"def part():\n{SET_TCP}{body}end\n"
    (folder / "part.script").write_bytes(text.encode())
    return program_files(folder / "part.script", None).load(None, None).moves


def left(found: CompensatedFiles) -> dict[int, str]:
    return {each.line: each.words for each in found.program.left}


def sent_poses(text: str) -> list[Floats]:
    """The poses of a program, mm."""
    found = []
    for body in re.findall(r"p\[([^\]]*)\]", text):
        numbers = np.array([float(part) for part in body.split(",")])
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(numbers[3:]).as_matrix(), numbers[:3] * 1000.0
        found.append(matrix)
    return found


def real_place(sent: Floats) -> Floats:
    """Where the true tool is when the calibrated controller goes to `sent`."""
    found = inverse(CHAIN, sent, np.radians(CORNER))
    assert found.converged
    return np.asarray(TRUE.pose(found.q))[:3, 3]


def test_with_the_new_numbers_the_true_robot_is_where_the_program_wanted_it(tmp_path: Path) -> None:
    targets = [shifted(0.0), shifted(60.0, 20.0), shifted(40.0, -90.0, 30.0)]
    body = f"  movej({HOME})\n  movel({p(targets[0])}, a=1.2)\n  global P2={p(targets[1])}\n  movel(P2, v=0.1)\n"
    body += f"  movej(get_inverse_kin({p(targets[2])}, qnear={q(CORNER)}), a=1.4)\n"
    found = compensated(tmp_path, body)
    assert not found.program.left
    sent = sent_poses(found.texts()["script"].decode())[1:]
    for wanted, each in zip(targets, sent, strict=True):
        assert np.linalg.norm(real_place(wanted) - wanted[:3, 3]) > 0.3
        assert np.linalg.norm(real_place(each) - wanted[:3, 3]) < 1e-4
    assert max(each.after_mm for each in found.program.changed.values()) < 1e-4


def test_joints_are_written_in_the_unit_in_which_they_stand(tmp_path: Path) -> None:
    degrees = ", ".join(f"d2r({angle})" for angle in CORNER)
    found = compensated(tmp_path, f"  movej([{degrees}], a=1.4)\n  movel({q(CORNER + np.eye(6)[0])})\n")
    assert not found.program.left
    text = found.texts()["script"].decode()
    new = np.array([float(each) for each in re.findall(r"d2r\(([^)]*)\)", text)])
    assert len(new) == 6
    reached = np.asarray(TRUE.pose(np.radians(new)))[:3, 3]
    assert np.linalg.norm(reached - pose_at(CORNER)[:3, 3]) < 1e-4


def test_every_other_byte_stays(tmp_path: Path) -> None:
    body = f'  # Gruß\r\n\t movej({HOME} , a = 1.4)\r\n  $ 3 "MoveL"\n  movel({p(shifted(10))},v=0.1)# end\n'
    found = compensated(tmp_path, body)
    before, after = (tmp_path / "part.script").read_bytes(), found.texts()["script"]
    number = rb"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?"
    assert re.sub(number, b"0", before) == re.sub(number, b"0", after)
    assert before != after
    changed = [line for line, old in zip(after.split(b"\n"), before.split(b"\n"), strict=True) if line != old]
    assert len(changed) == 2


def test_a_feature_is_taken_into_account(tmp_path: Path) -> None:
    turn = Rotation.from_euler("ZYX", [30.0, 5.0, -4.0], degrees=True).as_matrix()
    feature = np.eye(4)
    feature[:3, :3], feature[:3, 3] = turn, [300.0, -100.0, 50.0]
    wanted = shifted(30.0, 30.0)
    body = f"  Plane={p(feature)}\n  movej({HOME})\n  movel(pose_trans(Plane, {p(np.linalg.inv(feature) @ wanted)}))\n"
    found = compensated(tmp_path, body)
    assert not found.program.left
    poses = sent_poses(found.texts()["script"].decode())
    np.testing.assert_allclose(poses[1], feature, atol=1e-9)
    assert np.linalg.norm(real_place(feature @ poses[2]) - wanted[:3, 3]) < 1e-4


def test_a_circle_is_compensated_with_its_point_on_the_way(tmp_path: Path) -> None:
    via, end = shifted(60.0, 60.0), shifted(120.0, 0.0)
    found = compensated(tmp_path, f"  movej({q(CORNER)})\n  movec({p(via)}, {p(end)}, a=1.2, v=0.1)\n")
    assert not found.program.left
    (path,) = found.paths
    assert not path.reason
    assert path.bound_mm < path.before_mm


REASONS = {
    "movel(pose_add(P, P))": "the point is computed",
    "movel(P)": "P is not in this file",
    "movel(get_actual_tcp_pose())": "the point is computed",
    "movel(p[0.1, 0.2, x, 0, 0, 0])": "a number of it is computed",
    "movej([0, 1, 2])": "has 3 numbers, and a list of joints has 6",
    "movej(get_inverse_kin(p[0.4,0.2,0.3,0,3,0], qnear=q))": "qnear of its get_inverse_kin is computed",
    "movej(get_inverse_kin(p[0.4,0.2,0.3,0,3,0], [0,0,0,0,0,0], 1, 1, T))": "a TCP of its own",
    "P1=p[0.5,0.2,0.3,0,3,0]\n  movel(P1)\n  P2=pose_trans(P1, P1)": "P1 is also used in line 6",
    "P1=p[0.5,0.2,0.3,0,3,0]\n  movel(P1)\n  P1[2]=0.3": "assigned more than once",
    "movel(pose_trans(F(), p[0.5,0.2,0.3,0,3,0]))": "the feature F() is computed, or changes",
    "movel(p[9,0,0,0,0,0])": "out of the robot's reach",
    "servoj([0,0,0,0,0,0])": "it has no point that stays",
    "what is this": "not understood",
    "set_tcp(T)\n  movel(p[0.5,0.2,0.3,0,3,0])": "set_tcp in line 4 is computed",
    "set_tcp(p[0,0,0.1,0,0,0])\n  movej([0,-1,1,0,0,0])": "wrong tool",
    "unknown_function()\n  movej([0,-1,1,0,0,0])": "unknown_function in line 4 is not in this file",
}


@pytest.mark.parametrize(("line", "words"), REASONS.items(), ids=list(REASONS))
def test_what_is_not_certain_stays_and_is_named(tmp_path: Path, line: str, words: str) -> None:
    found = compensated(tmp_path, f"  movej({HOME})\n  {line}\n")
    assert words in " | ".join(left(found).values())
    assert len(found.program.changed) == 1


def test_a_data_sheet_model_compensates_joints_and_leaves_poses(tmp_path: Path) -> None:
    found = compensated(tmp_path, f"  movej({HOME})\n  movel({p(shifted(10))})\n", model(SHEET))
    assert "computes positions with its arm's calibration" in left(found)[4]
    assert [each.point.line for each in found.program.changed.values()] == [3]


def test_the_first_pose_needs_a_posture(tmp_path: Path) -> None:
    found = compensated(tmp_path, f"  movel({p(shifted(10))})\n  movej({HOME})\n")
    assert "get_inverse_kin(p, qnear=[…])" in left(found)[3]


def test_the_start_of_a_motion_is_certain_only_where_every_way_leads_from_the_same(tmp_path: Path) -> None:
    pose = p(shifted(10))
    body = f"""  movej({HOME})
  sleep(0.1)
  movel({pose})
  while True:
    movel({pose})
    movel({pose})
  end
  if get_digital_in(1):
    movel({pose})
  else:
    movel({pose})
  end
  movel({pose})
  sub()
  movel({pose})
"""
    text = f"def part():\n{SET_TCP}  def sub():\n    movel({pose})\n  end\n{body}end\n"
    starts = [each.start for each in moves(tmp_path, text, whole=True)]
    assert starts == [None, None, 1, None, 3, None, None, None, None]


def test_a_function_has_the_tool_of_its_calls_and_a_thread_has_none(tmp_path: Path) -> None:
    sub = f"  def sub():\n    movej({HOME})\n  end\n"
    one = f"def part():\n{sub}{SET_TCP}  sub()\n  sub()\nend\n"
    assert moves(tmp_path, one, whole=True)[0].tool.numbers is not None
    other = one.replace("  sub()\nend", "  set_tcp(p[0,0,0.2,0,0,0])\n  sub()\nend")
    assert "differs" in moves(tmp_path, other, whole=True)[0].tool.reason
    changing = f"def part():\n  def sub():\n  {SET_TCP}  end\n{SET_TCP}  sub()\n  movej({HOME})\nend\n"
    assert "sub in line 6 may set it" in moves(tmp_path, changing, whole=True)[0].tool.reason
    for inside in (f"movej({HOME})", "set_tcp(T)", "sub()"):
        thread = f"def part():\n{sub}{SET_TCP}  thread t():\n    {inside}\n  end\n  x = run t()\n  movej({HOME})\nend\n"
        assert {each.tool.numbers for each in moves(tmp_path, thread, whole=True)} == {None}, inside


def test_a_stated_tool_stands_for_that_of_the_program_and_not_for_several(tmp_path: Path) -> None:
    tool = f"0,0,{TOOL_MM},0,0,0"
    text = f"def part():\n  movej({HOME})\nend\n"
    assert compensated(tmp_path, text, whole=True, tool=tool).program.changed
    with pytest.raises(InputError, match="the program uses several"):
        compensated(tmp_path, f"  set_tcp(p[0,0,0.2,0,0,0])\n  movej({HOME})\n", tool=tool)
    with pytest.raises(InputError, match="in its features"):
        compensated(tmp_path, f"  movej({HOME})\n", base="0,0,0,0,0,0")


def test_nothing_that_can_be_compensated_is_refused_with_every_reason(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing was written") as refused:
        compensated(tmp_path, "  movel(A)\n  movel(B)\n")
    assert len(refused.value.problems) == 2


def inserted(folder: Path, motion: str) -> tuple[CompensatedFiles, list[str]]:
    found = compensated(folder, f"  movej({q(CORNER)})\n  {motion}\n", insert=True, path_tolerance=0.002)
    return found, found.texts()["script"].decode().splitlines()


def test_points_are_inserted_where_the_path_leaves_the_tolerance(tmp_path: Path) -> None:
    found, lines = inserted(tmp_path, f"movel({p(shifted(300, -300, 200))}, a=1.2, v=0.1)")
    (path,) = found.paths
    assert path.between is not None
    assert path.final_mm <= 0.002
    at = next(number for number, line in enumerate(lines) if line.startswith("  # cellctl: "))
    count = len(path.between.sent) - 1
    new = re.compile(r"  movel\(p\[[^\]]*\], a=1.2, v=0.1, r=0\.\d+\)")
    assert all(new.fullmatch(line) for line in lines[at + 1 : at + 1 + count])
    assert lines[at + 1 + count].endswith("a=1.2, v=0.1)")


@pytest.mark.parametrize(
    ("ending", "words"), [("t=3", "its time t"), ("a=1.2, r=0.02", "blended"), ("1.2, 0.1, 0, 0.02", "blended")]
)
def test_a_motion_with_a_time_or_a_blend_is_not_divided(tmp_path: Path, ending: str, words: str) -> None:
    found, _ = inserted(tmp_path, f"movel({p(shifted(300, -300, 200))}, {ending})")
    assert found.paths[0].between is None
    assert words in found.paths[0].undivided


def test_an_arc_in_parts_gets_new_points_on_the_way(tmp_path: Path) -> None:
    motion = f"movec({p(shifted(150, 150))}, {p(shifted(300, 0))}, a=1.2, v=0.1)"
    found, lines = inserted(tmp_path, motion)
    (path,) = found.paths
    assert path.between is not None
    arcs = [line for line in lines if "movec(" in line]
    assert len(arcs) == len(path.between.sent)
    assert all(len(sent_poses(line)) == 2 for line in arcs)
    wanted = shifted(150, 150)[:3, 3]
    last = sent_poses(arcs[-1])[0]
    assert np.linalg.norm(last[:3, 3] - wanted) > 20.0
