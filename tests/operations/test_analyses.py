"""An analysis: a folder that holds a data file, what it was understood as, and the results of its fit."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from cellctl.files import InputError
from cellctl.formats import ModelFile, RobotFile
from cellctl.journal import JournalError
from cellctl.journal.journal_file import WriterLock
from cellctl.operations import analyses
from cellctl.operations.analyses import FitSettings
from cellctl.operations.analysis_programs import ProgramRequest, compensate_analysis, new_program
from cellctl.operations.exporting import ExportOptions, exported, read_source
from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv
from tests.helpers.krl import usual_seam

INPUTS = Path(__file__).parents[1] / "golden" / "inputs"


def started(runs: Path, data: str = "positions.csv", robot: str = "robot.yaml") -> Path:
    """A new analysis of a golden input, understood."""
    folder, record = analyses.new_analysis(runs, "Ada", data)
    shutil.copy(INPUTS / data, folder / record.data)
    shutil.copy(INPUTS / robot, folder / robot)
    analyses.set_robot(folder, file=robot)
    analyses.understand_analysis(folder)
    return folder


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = started(tmp_path_factory.mktemp("runs"))
    analyses.fit_analysis(folder, FitSettings(model="geometry"))
    return folder


@pytest.mark.long
def test_a_fit_gives_model_report_urdf_and_the_verdict_of_the_command_line(fitted: Path) -> None:
    state = analyses.state_of(fitted)
    report = json.loads((fitted / "fit.json").read_text())
    assert state.outcome
    assert (state.state, state.outcome.verdict) == ("done", report["verdict"])
    assert state.outcome.sentence == report["sentence"]
    assert set(state.files) == {"model.json", "report.html", "robot.urdf", "fit.json"}
    assert ModelFile.load(fitted / "model.json").robot.name == "elbow arm"


def test_an_analysis_is_listed_with_its_state_the_newest_first(fitted: Path) -> None:
    runs = fitted.parents[1]
    newer, _ = analyses.new_analysis(runs, "Ada", "zz.csv")
    try:
        found = analyses.analyses(runs)
        assert [(each.name, each.state) for each in found] == [(newer.name, "new"), (fitted.name, "done")]
    finally:
        shutil.rmtree(newer)


def test_the_log_of_a_fit_rises_to_its_end(fitted: Path) -> None:
    shares = [json.loads(line)["share"] for line in (fitted / analyses.LOG).read_text().splitlines()]
    assert shares == sorted(shares)
    assert shares[-1] > 0.95


def test_a_refused_fit_keeps_its_problems_as_the_command_line_states_them(tmp_path: Path) -> None:
    folder = started(tmp_path)
    with pytest.raises(InputError):
        analyses.fit_analysis(folder, FitSettings(holdout=2.0))
    outcome = analyses.state_of(folder).outcome
    assert outcome
    assert outcome.failure
    assert (outcome.state, outcome.code, outcome.meaning) == ("failed", 2, "the input is wrong")
    assert outcome.failure.problems[0].what == "2 is no share"


def test_a_wrong_robot_file_is_refused_at_its_place(tmp_path: Path) -> None:
    folder, record = analyses.new_analysis(tmp_path, "Ada", "positions.csv")
    shutil.copy(INPUTS / "positions.csv", folder / record.data)
    (folder / "arm.yaml").write_text("name: arm\nlinks: 7\n")
    analyses.set_robot(folder, file="arm.yaml")
    with pytest.raises(InputError) as caught:
        analyses.understand_analysis(folder)
    assert {problem.file for problem in caught.value.problems} == {"arm.yaml"}


def test_errors_name_the_uploaded_file_without_its_folder(tmp_path: Path) -> None:
    folder = started(tmp_path)
    (folder / "positions.csv").write_text("A1,A2,A3\n1,2,3\n")
    with pytest.raises(InputError) as caught:
        analyses.fit_analysis(folder, FitSettings())
    assert {problem.file for problem in caught.value.problems} == {"positions.csv"}


def test_a_fit_that_was_killed_is_cut_off(tmp_path: Path) -> None:
    folder = started(tmp_path)
    (folder / analyses.LOG).touch()
    assert analyses.state_of(folder).state == "cut off"


def test_one_analysis_is_fitted_by_one_process(tmp_path: Path) -> None:
    folder = started(tmp_path)
    lock = WriterLock.take(folder / analyses.LOCK)
    try:
        assert analyses.state_of(folder).state == "running"
        with pytest.raises(JournalError):
            analyses.fit_analysis(folder, FitSettings())
    finally:
        lock.release()


def test_the_library_robot_that_agrees_is_taken(tmp_path: Path) -> None:
    folder, record = analyses.new_analysis(tmp_path, "Ada", "poses.csv")
    shutil.copy(INPUTS / "poses.csv", folder / record.data)
    found = analyses.understand_analysis(folder)
    assert analyses.Analysis.load(folder).library == "kr5_r1400"
    assert found["robot"] == "KUKA KR5 R1400"


@pytest.fixture
def with_model(tmp_path: Path) -> Path:
    """An analysis of a KR5 with its model."""
    folder, _ = analyses.new_analysis(tmp_path, "Ada", "poses.csv")
    kr5_model().save(folder / analyses.MODEL)
    return folder


def test_a_program_is_compensated_with_its_deviations_and_the_original_is_kept(with_model: Path) -> None:
    given = new_program(with_model)
    usual_seam().write(given)
    (given / "$config.dat").rename(given / analyses.safe_name("$config.dat"))
    before = (given / "seam.dat").read_bytes()
    found = compensate_analysis(with_model, given.parent.name, ProgramRequest(("seam.src", "seam.dat", "config.dat")))
    assert found.files == ("seam.src", "seam.dat")
    assert found.compensated == 5
    predicted = found.predicted
    assert predicted[0]["mean"] > 1.0 > 0.01 > predicted[1]["max"]
    assert (given.parent / "seam.dat").read_bytes() != before == (given / "seam.dat").read_bytes()
    assert analyses.programs(with_model) == (found,)


@pytest.mark.long
def test_a_set_up_error_is_found_with_the_best_robots_where_none_agrees_as_it_is(tmp_path: Path) -> None:
    heading, *rows = analyses.EXAMPLE.read_text().splitlines()
    place = heading.split(",").index("A6")
    cells = [row.split(",") for row in rows]
    reversed_ = [[f"{-float(cell)}" if at == place else cell for at, cell in enumerate(row)] for row in cells]
    folder, record = analyses.new_analysis(tmp_path, "me", "reversed.csv")
    (folder / record.data).write_text("\n".join([heading, *map(",".join, reversed_)]) + "\n")
    analyses.understand_analysis(folder)
    found = analyses.understanding(folder)
    assert found is not None
    assert analyses.Analysis.load(folder).robot == ""
    assert found.candidate is not None
    assert found.candidate.name == "kr5_r1400"
    assert any(problem.what.startswith("A6 reversed: RMS") for problem in found.candidate.problems)


@pytest.mark.long
def test_another_robot_is_doubted_with_figures_before_the_fit(tmp_path: Path) -> None:
    folder, record = analyses.new_analysis(tmp_path, "Ada", "positions.csv")
    shutil.copy(INPUTS / "positions.csv", folder / record.data)
    longer = (INPUTS / "robot.yaml").read_text().replace("a: 500", "a: 520")
    (folder / "arm.yaml").write_text(longer)
    analyses.set_robot(folder, file="arm.yaml")
    found = analyses.understand_analysis(folder)
    assert found["doubt"].startswith("Is this the robot that was measured? With base and tool fitted, the elbow arm is")


def test_targets_are_compensated_to_joints_with_predicted_errors(with_model: Path) -> None:
    given = new_program(with_model)
    (given / "targets.csv").write_text(targets_csv(readings_near_the_middle(4)))
    found = compensate_analysis(with_model, given.parent.name, ProgramRequest(("targets.csv",)))
    assert (found.compensated, found.files) == (4, ("targets-compensated.csv",))
    assert len((given.parent / "targets-compensated.csv").read_text().splitlines()) == 5


def test_a_wrong_program_is_refused_at_its_line_and_leaves_no_result(with_model: Path) -> None:
    given = new_program(with_model)
    (given / "targets.csv").write_text("X,Y,Z,A,B,C\n9000,0,0,0,0,0\n")
    with pytest.raises(InputError) as caught:
        compensate_analysis(with_model, given.parent.name, ProgramRequest(("targets.csv",)))
    assert [(problem.file, problem.line) for problem in caught.value.problems] == [("targets.csv", 2)]
    assert analyses.programs(with_model) == ()


def test_two_programs_at_once_are_refused(with_model: Path) -> None:
    with pytest.raises(InputError, match="not one program"):
        compensate_analysis(with_model, new_program(with_model).parent.name, ProgramRequest(("a.src", "b.src")))


@pytest.mark.parametrize(
    ("given", "safe"),
    [
        ("../../etc/passwd", "passwd"),
        ("C:\\data\\Messung 1.csv", "Messung_1.csv"),
        (".hidden.csv", "hidden.csv"),
        ("x" * 300 + ".csv", "x" * 77 + ".csv"),
        ("", "file"),
        ("..", "file"),
        ("mess.daten.v1.csv", "mess.daten.v1.csv"),
        ("Prüfung März.csv", "Pruefung_Maerz.csv"),
        ("Pru\u0308fung.csv", "Pruefung.csv"),
        ("éà.csv", "ea.csv"),
        ("测量.csv", "file.csv"),
    ],
)
def test_names_of_uploaded_files_are_made_safe(given: str, safe: str) -> None:
    assert analyses.safe_name(given) == safe


@pytest.mark.parametrize("data", ["mess.daten.v1.csv", "Prüfung März.csv", "x" * 80 + ".csv", "äöü.csv", "ohne"])
def test_an_analysis_of_any_data_file_is_found_again_by_its_name(tmp_path: Path, data: str) -> None:
    folder, record = analyses.new_analysis(tmp_path, "Ada", data)
    assert analyses.analysis_folder(tmp_path, record.name) == folder


@pytest.mark.parametrize("name", ["..", "../runs", "missing", "", "a/b"])
def test_no_folder_outside_the_analyses_is_opened(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="no such analysis"):
        analyses.analysis_folder(tmp_path, name)


@pytest.fixture
def with_urdf(tmp_path: Path) -> Path:
    """An analysis whose robot is a URDF, not read yet."""
    folder, record = analyses.new_analysis(tmp_path, "Ada", "positions.csv")
    shutil.copy(INPUTS / "positions.csv", folder / record.data)
    made = exported(read_source(INPUTS / "robot.yaml", None, None, None), "urdf", ExportOptions())
    (folder / "arm.urdf").write_text(str(made.content))
    analyses.set_robot(folder, file="arm.urdf")
    return folder


@pytest.mark.long
def test_a_urdf_is_converted_and_understood_as_the_robot_file_is(with_urdf: Path) -> None:
    replace(analyses.Analysis.load(with_urdf), answers={"repeatability": "0,05"}).save(with_urdf)
    found = analyses.understand_analysis(with_urdf)
    record = analyses.Analysis.load(with_urdf)
    assert (record.robot, record.library, found["problems"]) == ("arm.yaml", "", [])
    assert RobotFile.load(with_urdf / "arm.yaml").repeatability == 0.05
    assert analyses.fit_analysis(with_urdf, FitSettings(model="geometry")).verdict == "better"


@pytest.mark.parametrize(("given", "what"), [("", "does not say the robot's repeatability"), ("x", "no repeatability")])
def test_a_urdf_needs_the_repeatability(with_urdf: Path, given: str, what: str) -> None:
    replace(analyses.Analysis.load(with_urdf), answers={"repeatability": given}).save(with_urdf)
    with pytest.raises(InputError, match=what) as refused:
        analyses.understand_analysis(with_urdf)
    assert "--repeatability" in refused.value.problems[0].cure
    assert (refused.value.problems[0].file, analyses.Analysis.load(with_urdf).robot) == ("arm.urdf", "arm.urdf")
