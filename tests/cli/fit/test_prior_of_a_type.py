"""`cellctl prior` and `cellctl fit --prior-of-type`: from the models of a type's robots to the fit of another one."""

import json

import numpy as np
import pytest

from cellctl.formats import ModelFile
from cellctl.formats.type_prior import TypePriorFile
from tests.helpers.arms import (
    ELBOW_ROBOT,
    ElbowArm,
    cellctl,
    csv_text,
    drawn,
    joints_and_places,
    printed_errors,
)

ROBOTS = 6
NOISE_MM = 0.02 / np.sqrt(3)


def arm_of(robot):
    """Robots of one type: links 0.6 mm off, spread by a tenth."""
    off, zero = np.random.default_rng([robot, 3]).normal(0.0, [0.05, 0.005])
    return ElbowArm(upper=500.6 + off, fore=449.5 - off, zero_deg=0.04 + zero)


def rows_of(arm, count, seed):
    rng = np.random.default_rng(seed)
    readings = drawn(rng, count)
    return csv_text(joints_and_places(readings, arm.tcp(readings) + rng.normal(0, NOISE_MM, (count, 3))))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Runs `run0` … `run5` of robots with serials, a robot file, and few rows of a further robot."""
    folder = tmp_path_factory.mktemp("type")
    (folder / "robot.yaml").write_text(ELBOW_ROBOT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for robot in range(ROBOTS):
            (folder / f"{robot}.csv").write_text(rows_of(arm_of(robot), 40, robot))
            assert cellctl("fit", "robot.yaml", f"{robot}.csv", "--model", "geometry", "-o", "model.json") == 0
            model = ModelFile.load(folder / "model.json")
            run = folder / f"run{robot}"
            run.mkdir()
            of_run = {"robot_serial": f"SN{robot}"}
            model.model_copy(update={"provenance": model.provenance | of_run}).save(run / "model.json")
    (folder / "few.csv").write_text(rows_of(arm_of(99), 9, 99))
    return folder


@pytest.fixture
def folder(made, monkeypatch):
    monkeypatch.chdir(made)
    return made


RUNS = [f"run{robot}" for robot in range(ROBOTS)]


@pytest.fixture
def prior(folder):
    assert cellctl("prior", *RUNS, "-o", "prior.json") == 0
    return TypePriorFile.load(folder / "prior.json")


@pytest.mark.long
def test_a_prior_names_type_robots_and_inputs_and_has_nothing_of_base_and_tool(prior, folder):
    assert prior.robot.name == "elbow arm"
    assert [robot.serial for robot in prior.robots] == [f"SN{robot}" for robot in range(ROBOTS)]
    assert all(len(robot.model_sha256) == len(robot.data_sha256) == 64 for robot in prior.robots)
    names = {parameter.name: parameter for parameter in prior.parameters}
    assert not [name for name in names if name.startswith(("base", "tool"))]
    true = np.mean([arm_of(robot).upper for robot in range(ROBOTS)]) - 500.0
    assert abs(names["a2"].mean - true) < 0.05
    assert names["a2"].sigma < 0.6 * names["a2"].tolerance
    assert prior.text() == (folder / "prior.json").read_text()


def test_a_fit_of_few_rows_is_better_with_the_prior_and_states_its_hash(prior, folder):
    def error(*options):
        cellctl("fit", "robot.yaml", "few.csv", "--model", "geometry", "-o", "few.json", *options)
        model, readings = ModelFile.load(folder / "few.json"), drawn(np.random.default_rng(7), 300)
        away = model.predict(readings).poses[:, :3, 3] - arm_of(99).tcp(readings)
        return float(np.sqrt(np.mean(np.sum(away**2, axis=1)))), model

    (without, _), (within, model) = error(), error("--prior-of-type", "prior.json")
    assert within < without
    assert len(model.provenance["type_prior_sha256"]) == 64


def test_another_type_is_refused(prior, folder, capsys):
    (folder / "longer.yaml").write_text(ELBOW_ROBOT.replace("a: 500", "a: 600").replace("elbow arm", "long arm"))
    assert cellctl("fit", "longer.yaml", "few.csv", "--prior-of-type", "prior.json") == 2
    assert "is of type 'elbow arm', with another link table than 'long arm' has" in printed_errors(capsys)


def test_rows_that_the_prior_was_made_with_are_refused_and_the_cure_works(prior, folder, capsys):
    assert cellctl("fit", "robot.yaml", "2.csv", "--prior-of-type", "prior.json") == 2
    said = printed_errors(capsys)
    assert "was made with robot SN2 itself (run2): its rows would count twice" in said
    assert "cellctl prior … --without SN2" in said
    assert cellctl("prior", *RUNS, "--without", "SN2", "-o", "others.json") == 0
    assert cellctl("fit", "robot.yaml", "2.csv", "--prior-of-type", "others.json", "--model", "geometry") == 0


def test_of_two_runs_of_a_robot_the_last_given_counts(folder):
    again = folder / "again"
    again.mkdir()
    (again / "model.json").write_text((folder / "run1" / "model.json").read_text())
    assert cellctl("prior", *RUNS, "again", "-o", "p.json", "--json", "p2.json") == 0
    found = json.loads((folder / "p2.json").read_text())
    assert [each["run"] for each in found["robots"]] == ["run0", "run2", "run3", "run4", "run5", "again"]
    assert found["left_out"] == [{"run": "run1", "why": "the run again is of the same robot, SN1"}]


def test_too_few_robots_and_runs_without_a_model_are_refused(folder, capsys):
    assert cellctl("prior", "run0", "run1") == 2
    assert "2 robots have no spread to speak of" in printed_errors(capsys)
    assert cellctl("prior", "run0", "nowhere") == 2
    assert "has no model" in printed_errors(capsys)


def test_a_model_that_was_fitted_with_a_prior_of_the_type_makes_no_further_one(prior, folder, capsys):
    options = ("--model", "geometry", "--prior-of-type", "prior.json", "-o", "few.json")
    cellctl("fit", "robot.yaml", "few.csv", *options)
    capsys.readouterr()
    assert cellctl("prior", "few.json", "run0", "run1") == 2
    assert "it was fitted with a prior of the type, which would count again" in printed_errors(capsys)


def test_a_prior_model_of_the_robot_and_a_prior_of_its_type_exclude_each_other(prior, capsys):
    words = ("--prior", "run0/model.json", "--prior-of-type", "prior.json")
    assert cellctl("fit", "robot.yaml", "few.csv", *words) == 2
    assert "--prior-of-type: does not go with --prior" in printed_errors(capsys)


def test_a_file_of_another_kind_is_refused_in_a_sentence(prior, capsys):
    assert cellctl("fit", "robot.yaml", "few.csv", "--prior-of-type", "run0/model.json") == 2
    assert "this is a model file, and a prior file is needed here" in printed_errors(capsys)
