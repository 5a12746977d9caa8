"""A prior model of several sessions: partial work updates the session that the new rows name."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.arms import ElbowArm, cellctl, csv_text, drawn, identified_elbow, joints_and_places

NOISE_MM = 0.02 / math.sqrt(3)
MONDAY = ElbowArm()
TUESDAY = replace(MONDAY, at=(300.0, -250.0, 90.0), turn_deg=35.0)
LOST = (0.4, -1.2, 0.7)


def measured(days, count, seed):
    """Rows of each day's arm; days: arm by name."""
    rng = np.random.default_rng(seed)
    texts = []
    for name, arm in days.items():
        readings = drawn(rng, count)
        columns = joints_and_places(readings, arm.tcp(readings) + rng.normal(0, NOISE_MM, (count, 3)))
        texts.append(csv_text({**columns, "session": np.full(count, name)} if name else columns))
    return texts[0] + "".join(text.split("\n", 1)[1] for text in texts[1:])


@pytest.fixture(scope="module")
def older(tmp_path_factory):
    return identified_elbow(
        tmp_path_factory.mktemp("sessions"), measured({"Monday": MONDAY, "Tuesday": TUESDAY}, 40, 1)
    )


@pytest.fixture
def folder(older, monkeypatch):
    monkeypatch.chdir(older)
    return older


@pytest.mark.parametrize(("name", "day"), [("Monday", MONDAY), ("Tuesday", TUESDAY)])
def test_lost_zeros_are_found_where_the_robot_stood_in_the_session_of_that_name(folder, name, day):
    (folder / "few.csv").write_text(measured({name: replace(day, lost_deg=LOST)}, 12, 2))
    words = ["fit", "robot.yaml", "few.csv", "--prior", "model.json", "--free", "zeros", "--json", "r.json"]
    assert cellctl(*words) == 0
    result = json.loads((folder / "r.json").read_text())
    assert max(result["noise_growth"]) < 2.0
    for row, true in zip(result["mastering"], LOST, strict=True):
        assert abs(row["offset_deg"] - true) < 4.0 * row["sigma_deg"]
        assert row["sigma_deg"] < 0.02


@pytest.mark.parametrize("name", ["", "Friday"])
def test_rows_of_no_session_that_the_prior_model_knows_are_refused_with_the_names(folder, name, capsys):
    (folder / "few.csv").write_text(measured({name: TUESDAY}, 12, 2))
    assert cellctl("fit", "robot.yaml", "few.csv", "--prior", "model.json", "--free", "zeros") == 2
    assert "Monday, Tuesday" in capsys.readouterr().err


def test_touches_alone_do_not_go_on_from_just_any_sessions_tool(folder, capsys):
    """An update without an instrument keeps the older model's tool: whose, where each session has its own?"""
    (folder / "days.csv").write_text(measured({"Monday": MONDAY, "Tuesday": TUESDAY}, 40, 1))
    own = ["--model", "geometry", "--own", "base,tool", "--out", "own.json"]
    assert cellctl("fit", "robot.yaml", "days.csv", *own) == 0
    readings = drawn(np.random.default_rng(3), 40)
    far = np.linalg.norm(TUESDAY.tcp(readings) - [900.0, 500.0, 300.0], axis=1)
    columns = joints_and_places(readings, TUESDAY.tcp(readings))
    kept = {name: values for name, values in columns.items() if name not in ("X", "Y", "Z")}
    (folder / "bar.csv").write_text(csv_text({**kept, "anchor": np.full(40, "P"), "distance": far}))
    assert cellctl("fit", "robot.yaml", "bar.csv", "--prior", "own.json") == 2
    assert "Monday, Tuesday" in capsys.readouterr().err


def test_a_robot_set_up_anew_needs_no_session(folder):
    (folder / "few.csv").write_text(measured({"": TUESDAY}, 12, 2))
    words = ["fit", "robot.yaml", "few.csv", "--prior", "model.json", "--free", "base", "--json", "r.json"]
    assert cellctl(*words) == 0
    assert max(json.loads((folder / "r.json").read_text())["noise_growth"]) < 2.0


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (("sessions", 1, "covariance", 4, 4), -1.0, "covariance"),
        (("sessions", 1, "covariance"), [[0.0] * 29] * 29, "session 'Tuesday'"),
        (("sessions", 1, "base", 0, 0), 3.0, "rigid"),
    ],
)
def test_a_session_that_no_fit_wrote_is_refused(folder, capsys, place, value, words):
    damaged = json.loads((folder / "model.json").read_text())
    part = damaged
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    (folder / "damaged.json").write_text(json.dumps(damaged))
    (folder / "few.csv").write_text(measured({"Tuesday": TUESDAY}, 12, 2))
    assert cellctl("fit", "robot.yaml", "few.csv", "--prior", "damaged.json", "--free", "tool") == 2
    assert words in capsys.readouterr().err
