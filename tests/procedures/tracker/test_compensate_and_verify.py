"""Targets measured before and after their compensation, on devices without wires: by a model of an earlier run, or by
one that the run identifies first.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.engine import State
from cellctl.files import InputError, load_yaml
from cellctl.formats import ModelFile, TableFile
from cellctl.operations.campaign import load_campaign
from cellctl.procedure import CellFiles
from cellctl.records import TableStateRow
from cellctl.report import write_report
from procedures.steps.tracker.model_files import check_model, read_model_of
from procedures.steps.tracker.pose_plans import check_method
from procedures.steps.tracker.rows import CompensatedRow, PoseRow, SetUpRow, TargetPlanRow, TargetsRow, TrackerVerdict
from tests.helpers.arms import kr5_model
from tests.helpers.own_model import pose_of
from tests.helpers.steps import CELL, PROCEDURES, ROBOT, Context, FakeRobot, FakeRun, Faults, Truth, run_fake

PROCEDURE = PROCEDURES / "compensate_and_verify.yaml"
FEW: dict[str, Any] = {"targets": 8, "registration_poses": 15, "poses_fit": 30, "model": "geometry"}
OWN = FEW | {"targets": 6}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs, among them `own`."""
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def own(runs: Path) -> FakeRun:
    """A run without a model."""
    done = run_fake(PROCEDURE, runs, OWN, name="own")
    assert done.outcome.state is State.FINISHED, done.outcome.error
    return done


@pytest.fixture(scope="module")
def elsewhere(runs: Path, own: FakeRun) -> FakeRun:
    """A run by the model of `own`, the instrument set up anew, with targets of a file, two of which are left out."""
    truth = Truth.of(1)
    truth.station = pose_of(Rotation.from_rotvec([0.001, -0.001, 0.004]), [7.0, -9.0, 5.0]) @ truth.station
    poses = np.array([row.commanded for row in own.journal.recorded(PoseRow)])
    outside = poses[poses[:, 0].argmax()] + [4.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    singular = [0.0, -90.0, 90.0, 0.0, 0.0, 0.0]
    lines = ["A1,A2,A3,A4,A5,A6,set", *map(_line, (outside, singular, *poses[:9]))]
    (runs / "targets.csv").write_text("\n".join(lines) + "\n")
    values = FEW | {"model_run": "own", "target_file": str(runs / "targets.csv"), "method": "newton-raphson"}
    return run_fake(PROCEDURE, runs, values, truth=truth, name="elsewhere")


def _line(joints: Any) -> str:
    return ",".join(f"{angle:.4f}" for angle in joints) + ",test"


def verdict_of(run: FakeRun) -> TrackerVerdict:
    found = run.journal.last(TrackerVerdict)
    assert found is not None, run.outcome.error
    return found


def test_without_a_model_one_call_identifies_compensates_and_proves(own: FakeRun) -> None:
    found = verdict_of(own)
    assert (found.verdict, found.model_from, found.method) == ("better", None, "pseudo-target")
    assert found.targets is not None
    assert found.targets.n == 6
    assert found.targets.before.mean > 0.5
    assert found.targets.after.max < 0.15
    assert own.robot.tables[-1].id == own.journal.recorded(TableStateRow)[-1].id


def test_the_model_of_an_earlier_run_serves_with_the_instrument_at_another_place(elsewhere: FakeRun) -> None:
    found = verdict_of(elsewhere)
    assert elsewhere.outcome.state is State.FINISHED, elsewhere.outcome.error
    assert (found.verdict, found.model_from, found.method) == ("better", "own", "newton-raphson")
    assert found.targets is not None
    assert (found.targets.n, found.targets.before.mean > 0.5, found.targets.after.max < 0.15) == (8, True, True)
    assert found.model is not None
    assert found.model["groups"] == ["base"]


def test_the_registered_model_is_the_one_that_was_read_moved_as_a_whole(elsewhere: FakeRun, runs: Path) -> None:
    read, used = (ModelFile.load(runs / name / "model.json") for name in ("own", "elsewhere"))
    q = read.robot.joint_map().model(np.array([row.commanded for row in elsewhere.journal.recorded(PoseRow)]))
    motion = np.array(used.start["base"]) @ np.linalg.inv(read.start["base"])
    assert np.linalg.norm(motion[:3, 3]) > 5.0
    moved = read.robot_model().tcp(q) @ motion[:3, :3].T + motion[:3, 3]
    assert np.allclose(used.robot_model().tcp(q), moved, atol=1e-6)
    assert used.joint_region == read.joint_region


def test_targets_that_cannot_be_compensated_are_named_before_anything_moves(elsewhere: FakeRun) -> None:
    row = elsewhere.journal.recorded(TargetPlanRow)[0]
    reasons = {each.target: each.reason for each in row.left_out}
    assert "outside the measured region" in reasons["line 2 of targets.csv"]
    assert "cannot be measured" in reasons["line 3 of targets.csv"]
    assert set(reasons) == {str(each.target) for each in verdict_of(elsewhere).left_out}
    steps = list(elsewhere.journal.steps)
    assert steps.index("plan") < steps.index("prepare") < steps.index("warm_up")


def test_poses_that_register_the_model_are_not_judged_and_inside_its_region(elsewhere: FakeRun, runs: Path) -> None:
    rows = elsewhere.journal.recorded(PoseRow)
    fit, test = ([row for row in rows if row.set == name] for name in ("fit", "test"))
    assert (len(fit), len(test)) == (15, 8)
    assert {row.number for row in elsewhere.journal.recorded(CompensatedRow)} == {row.number for row in test}
    model = ModelFile.load(runs / "own" / "model.json")
    assert model.joint_region.inside(np.array([row.commanded for row in fit]), model.robot.joint_map()).all()


def test_the_verdict_states_how_sure_its_figures_are(elsewhere: FakeRun) -> None:
    found = verdict_of(elsewhere).targets
    assert found is not None
    assert found.mean_95 is not None
    assert found.mean_95[1][0] < found.after.mean < found.mean_95[1][1] < found.mean_95[0][0]
    assert found.share_below == pytest.approx(0.05 ** (1 / 8))
    assert any("95 % intervals" in line for line in verdict_of(elsewhere).lines)


@pytest.mark.long
def test_the_report_shows_each_target_before_and_after_and_names_those_left_out(elsewhere: FakeRun) -> None:
    page = write_report(elsewhere.folder).read_text()
    assert "target-bars" in page
    assert "newton-raphson (passes until it converges)" in page
    assert "The model is that of own" in page
    assert "line 2 of targets.csv" in page


@pytest.mark.long
def test_a_station_that_is_bumped_begins_a_new_session_with_the_model_of_an_earlier_run(
    runs: Path, own: FakeRun
) -> None:
    ended = run_fake(
        PROCEDURE,
        runs,
        FEW | {"model_run": "own", "monuments_every": 10, "targets": 24},
        faults=Faults(bump_at={34: 2.0}),
        name="bump",
    )
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    found = verdict_of(ended)
    assert found.sessions == ("1", "2")
    assert found.verdict == "better"
    assert found.ambiguous > 0
    assert found.after is not None
    assert found.after.max < 0.2


@pytest.mark.long
def test_a_run_that_ends_before_its_verdict_takes_the_table_back_and_is_resumed(runs: Path, own: FakeRun) -> None:
    given = FEW | {"model_run": "own"}
    ended = run_fake(PROCEDURE, runs, given, faults=Faults(lost=set(range(43, 999))), name="resumed")
    assert ended.outcome.state is State.FAILED
    assert 0 < len(ended.journal.recorded(CompensatedRow)) < 8
    assert not ended.robot.tables
    (runs / "own").rename(runs / "not there")
    again = run_fake(PROCEDURE, runs, given, resumed=ended, name="resumed")
    (runs / "not there").rename(runs / "own")
    assert again.outcome.state is State.FINISHED, again.outcome.error
    assert verdict_of(again).better
    assert len(again.journal.recorded(CompensatedRow)) == 8
    assert again.robot.tables[-1].id == again.journal.recorded(TargetsRow)[0].table


def test_one_pass_is_made_where_one_is_asked_for(runs: Path, own: FakeRun) -> None:
    ended = run_fake(PROCEDURE, runs, FEW | {"model_run": "own", "passes": 1}, name="once")
    assert verdict_of(ended).better
    assert ended.journal.recorded(TargetsRow)[0].passes == 1
    assert TableFile.load(runs / "once" / "table.json").source.method == "pseudo-target, 1 pass"
    assert any("passes: 1 at most" in line for line in verdict_of(ended).lines)


def test_a_table_by_which_targets_are_worse_is_rolled_back(
    runs: Path, own: FakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def off(robot: FakeRobot, row: int, speed_percent: float) -> tuple[float, ...]:
        return await robot.move(
            tuple(angle + 0.3 for angle in robot.tables[-1].rows[row - 1].compensated), speed_percent
        )

    monkeypatch.setattr(FakeRobot, "move_to_row", off)
    ended = run_fake(PROCEDURE, runs, FEW | {"model_run": "own"}, name="worse")
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    assert verdict_of(ended).verdict == "worse"
    assert not ended.robot.tables
    assert ended.journal.recorded(TableStateRow)[-1].active is False


def refused(run: FakeRun) -> str:
    assert isinstance(run.outcome.error, InputError)
    assert not run.robot.tables
    return str(run.outcome.error)


def changed_model(runs: Path, name: str, old: str, new: str) -> str:
    """A run folder whose model has another text; the folder's name."""
    text = (runs / "own" / "model.json").read_text()
    assert old in text
    (runs / name).mkdir()
    (runs / name / "model.json").write_text(text.replace(old, new))
    return name


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("stranger", '"robot_serial":"SIM-1"', '"robot_serial":"SIM-2"', "controller 'SIM-2'"),
        ("older", '"xyz":[59.9,', '"xyz":[61.9,', "the model is older than the tool"),
        ("longer", '"a":600.0', '"a":601.0', "robot file were changed after the model was identified"),
        ("renamed", '"name":"KUKA KR5 R1400"', '"name":"KUKA KR6"', "KUKA KR6"),
    ],
)
def test_a_model_of_another_robot_or_tool_is_refused_before_anything_moves(
    runs: Path, own: FakeRun, name: str, old: str, new: str, words: str
) -> None:
    given = FEW | {"model_run": changed_model(runs, name, old, new)}
    ended = run_fake(PROCEDURE, runs, given, name=f"refused-{name}")
    assert words in refused(ended)
    assert not ended.robot.moves


def test_a_model_that_is_not_there_or_named_twice_is_refused(runs: Path, own: FakeRun) -> None:
    nothing = run_fake(PROCEDURE, runs, FEW | {"model_file": str(runs / "no.json")}, name="nothing")
    assert "no.json" in refused(nothing)
    twice = run_fake(PROCEDURE, runs, FEW | {"model_file": "a.json", "model_run": "own"}, name="twice")
    assert "name the run or the file" in refused(twice)


def test_the_check_finds_a_model_that_is_missing_damaged_named_twice_or_of_another_robot(
    runs: Path, own: FakeRun
) -> None:
    def said(**named: str) -> str:
        with pytest.raises(InputError) as refused:
            check_model(CellFiles(load_yaml(CELL), ROBOT, 1, runs), named, of_reflector=True)
        return str(refused.value)

    damaged, other = runs / "damaged.json", runs / "other.json"
    damaged.write_text((runs / "own" / "model.json").read_text()[:1000])
    other.write_text((runs / "own" / "model.json").read_text().replace("KUKA KR5 R1400", "KUKA KR6"))
    assert "it is no JSON" in said(file=str(damaged))
    assert "name the run or the file" in said(file=str(damaged), run="own")
    assert "KUKA KR6" in said(file=str(other))
    with pytest.raises(InputError, match="there is no run 'none'"):
        load_campaign(PROCEDURE, None, ["model_run=none"], runs=runs)


def test_a_model_file_that_states_no_controller_is_taken_for_that_of_the_connected_one(
    runs: Path, own: FakeRun
) -> None:
    model = ModelFile.load(runs / "own" / "model.json")
    (runs / "fitted").mkdir()
    path = runs / "fitted" / "fitted.json"
    model.model_copy(update={"provenance": {}}).save(path)
    context = Context(robot_file=ROBOT, cell=load_yaml(CELL), serial="SIM-1")
    assert read_model_of(context, "", str(path), True).serial == "SIM-1"


def test_a_model_from_touches_is_refused_as_its_tool_is_not_the_reflector(runs: Path) -> None:
    kr5_model(touches=True, robot_serial="SIM-1").save(runs / "touched.json")
    ended = run_fake(PROCEDURE, runs, FEW | {"model_file": str(runs / "touched.json")}, name="touched")
    assert "no reflector is in it" in refused(ended)


def test_corrections_over_the_limit_of_the_cell_leave_no_target_and_nothing_moves(runs: Path, own: FakeRun) -> None:
    cell = runs / "cell.yaml"
    text = CELL.read_text().replace("../robots/", f"{ROBOT.parent}/")
    assert "limits:\n" in text
    cell.write_text(text.replace("limits:\n", "limits:\n  table: {correction_deg: 0.01}\n"))
    ended = run_fake(PROCEDURE, runs, FEW | {"model_run": "own"}, cell=cell, name="limited")
    assert "0 targets are left" in refused(ended)
    assert "the cell allows 0.01°" in refused(ended)
    assert not ended.robot.moves


def test_a_robot_that_is_not_as_the_model_says_gets_no_table(runs: Path, own: FakeRun) -> None:
    ended = run_fake(PROCEDURE, runs, FEW | {"model_run": "own"}, truth=Truth.of(2), name="changed")
    assert "is not as it was when it was identified" in refused(ended)
    assert "identify the robot as it is now" in refused(ended)


def test_an_unknown_method_is_refused_before_the_run_with_the_nearest_one() -> None:
    with pytest.raises(InputError, match="did you mean 'newton-raphson'"):
        check_method(CellFiles(load_yaml(CELL), ROBOT, 1), {"method": "newton-rapson"})


@pytest.mark.long
def test_the_report_states_the_air_and_the_instruments_common_error_in_its_budget(own: FakeRun) -> None:
    page = write_report(own.folder).read_text()
    setup, points = own.journal.recorded(SetUpRow)[-1], [row.point for row in own.journal.recorded(PoseRow)]
    assert setup.weather is not None
    common = np.sqrt(np.mean([np.sum(np.diag(point.common)) for point in points]))
    line = page.partition("instrument: alike in all points")[2].partition("</tr>")[0]
    assert [float(text) for text in re.findall(r'number">([0-9.]+)<', line)] == pytest.approx([common] * 2, rel=0.05)
    assert f"<dt>air pressure</dt><dd>{setup.weather.pressure_hpa:.1f} hPa</dd>" in page
    assert f"<dt>relative humidity</dt><dd>{setup.weather.humidity_percent:.0f} %</dd>" in page
