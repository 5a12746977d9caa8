"""Rows of several kinds, sessions and conditions in one data set, as a person fits them."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import Postures
from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile
from tests.helpers.arms import ELBOW_ROBOT, ElbowArm, csv_text, drawn, joints_and_places

NOISE_MM = 0.02 / math.sqrt(3)
ARM = ElbowArm()
AT_BASE = replace(ARM, at=(0.0, 0.0, 0.0))
SPHERE, SOCKET, ANCHOR = np.array([600.0, -200.0, 300.0]), np.array([550.0, 250.0, 350.0]), np.array([900.0, 0.0, 0.0])


@pytest.fixture
def cellctl(tmp_path, monkeypatch):
    (tmp_path / "robot.yaml").write_text(ELBOW_ROBOT)
    monkeypatch.chdir(tmp_path)
    return lambda *words: exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


@pytest.fixture
def fitted(cellctl, tmp_path):
    """Fits a data set's text; the JSON result."""

    def fit(text, *options, code=0):
        (tmp_path / "data.csv").write_text(text)
        assert cellctl("fit", "robot.yaml", "data.csv", "--json", "r.json", "--out", "m.json", *options) == code
        return json.loads((tmp_path / "r.json").read_text())

    return fit


def noise(rng, count):
    return rng.normal(0, NOISE_MM, (count, 3))


def places(rng, arm, count=30):
    readings = drawn(rng, count)
    return joints_and_places(readings, arm.tcp(readings) + noise(rng, count))


def touches(rng, count=30, centre=SPHERE):
    away = rng.normal(size=(count, 3))
    points = centre + 30.0 * away / np.linalg.norm(away, axis=1, keepdims=True)
    return AT_BASE.reaching(points + noise(rng, count), rng)


def joints(readings):
    return {f"A{j + 1}": readings[:, j] for j in range(3)}


def joined(*parts):
    """One data set of parts with different columns."""
    names = list(dict.fromkeys(name for part in parts for name in part))
    columns = {name: [] for name in names}
    for part in parts:
        count = len(part["A1"])
        for name in names:
            columns[name] += list(part.get(name, [""] * count))
    return csv_text(columns)


def test_every_kind_of_row_goes_into_one_fit_and_the_file_may_hold_them_in_any_order(fitted, tmp_path):
    rng = np.random.default_rng(1)
    ball_bar = drawn(rng, 30)
    distance = np.linalg.norm(AT_BASE.tcp(ball_bar) - ANCHOR, axis=1) + rng.normal(0, NOISE_MM, 30)
    parts = [
        {**joints(touches(rng)), "sphere": ["S1"] * 30, "radius": [30.0] * 30},
        {**joints(AT_BASE.reaching(SOCKET + noise(rng, 30), rng)), "socket": ["P"] * 30},
        {**joints(ball_bar), "anchor": ["bar"] * 30, "distance": distance},
        places(rng, ARM),
    ]
    head, *rows = joined(*parts).splitlines()
    shuffled = [rows[place] for place in rng.permutation(len(rows))]
    result = fitted("\n".join([head, *shuffled]), "--model", "geometry")
    assert result["measure"] == "sphere+socket+distance+position"
    assert result["n_test"] == 120
    assert result["test"]["mean"] < 0.03 < 0.05 < result["nominal"]["mean"]
    assert "held-out rows" in result["sentence"]
    centres = {centre.id: centre.xyz for centre in ModelFile.load(tmp_path / "m.json").centres}
    assert set(centres) == {"S1", "P", "bar"}
    assert np.linalg.norm(np.subtract(centres["S1"], centres["P"])) == pytest.approx(
        np.linalg.norm(SPHERE - SOCKET), abs=0.2
    )


def test_rows_of_other_kinds_than_the_one_asked_for_are_named(fitted, capsys):
    rng = np.random.default_rng(2)
    text = joined(places(rng, ARM), {**joints(touches(rng)[:3]), "sphere": ["S1"] * 3})
    result = fitted(text, "--measure", "position", "--model", "geometry")
    assert result["measure"] == "position"
    assert [row["line"] for row in result["rejected"]] == [32, 33, 34]
    assert "a touch, and only positions are asked for" in capsys.readouterr().err


def session(rng, name, arm, count=40, socket=None):
    if socket is None:
        return {**places(rng, arm, count), "session": [name] * count}
    readings = arm.reaching(socket + noise(rng, count), rng)
    return {**joints(readings), "socket": ["P"] * count, "session": [name] * count}


@pytest.mark.long
def test_each_session_has_its_own_base_unless_told_otherwise(fitted, tmp_path):
    rng = np.random.default_rng(3)
    moved = replace(ARM, at=(-400.0, 900.0, 50.0), turn_deg=-70.0)
    text = joined(session(rng, "Mon", ARM), session(rng, "Tue", moved))
    own = fitted(text, "--model", "geometry")
    assert own["test"]["mean"] < 0.03
    assert own["sessions"] == [
        {"name": "Mon", "rows": 40, "own": ["base"]},
        {"name": "Tue", "rows": 40, "own": ["base"]},
    ]
    sessions = ModelFile.load(tmp_path / "m.json").sessions
    first, second = (np.array(place.base) for place in sessions)
    turn = np.linalg.inv(first) @ second
    assert np.degrees(np.arctan2(turn[1, 0], turn[0, 0])) == pytest.approx(-70.0, abs=0.01)
    shared = fitted(text, "--model", "geometry", "--own", "none", "--no-check", code=1)
    assert shared["test"]["mean"] > 100.0


def test_a_session_that_the_fit_never_saw_is_judged_by_what_its_own_rows_cannot_explain(fitted, capsys):
    rng = np.random.default_rng(4)
    arms = [replace(ARM, at=(100.0 * number, 0.0, 0.0), turn_deg=20.0 * number) for number in range(3)]
    text = joined(*(session(rng, f"s{number}", arm) for number, arm in enumerate(arms)))
    result = fitted(text, "--model", "geometry", "--by", "session")
    assert list(result["by"]) == ["s0", "s1", "s2"]
    for figures in result["by"].values():
        assert figures["rows"] == 40
        assert figures["test"]["mean"] < 0.03 < 0.1 < figures["nominal"]["mean"]
    assert "s1, identified" in capsys.readouterr().out


def test_a_socket_of_the_same_name_is_another_one_where_the_robot_stands_elsewhere(cellctl, tmp_path):
    rng = np.random.default_rng(5)
    two = [session(rng, "a", AT_BASE, socket=SOCKET), session(rng, "b", AT_BASE, socket=SOCKET)]
    (tmp_path / "data.csv").write_text(joined(*two))
    for options, names in (((), ["P@a", "P@b"]), (("--own", "none"), ["P"])):
        assert cellctl("fit", "robot.yaml", "data.csv", "--model", "geometry", "--out", "m.json", *options) in (0, 1)
        assert [centre.id for centre in ModelFile.load(tmp_path / "m.json").centres] == names


@pytest.fixture
def two_sockets(cellctl, tmp_path):
    """Fits visits to two sockets; 1 σ over the region, and how far apart the sockets came out."""
    rng = np.random.default_rng(6)
    parts = [
        {**joints(AT_BASE.reaching(place + noise(rng, 30), rng)), "socket": [name] * 30}
        for name, place in (("P", SOCKET), ("Q", SPHERE))
    ]
    (tmp_path / "data.csv").write_text(joined(*parts))

    def fit(*options):
        words = ["fit", "robot.yaml", "data.csv", "--model", "geometry", "--json", "r.json", "--out", "m.json"]
        assert cellctl(*words, *options) in (0, 1)
        first, second = (np.array(centre.xyz) for centre in ModelFile.load(tmp_path / "m.json").centres)
        sure = json.loads((tmp_path / "r.json").read_text())["predicted_volumetric_rms"]
        return sure, float(np.linalg.norm(first - second))

    return fit


APART = float(np.linalg.norm(SOCKET - SPHERE))


def test_a_known_spacing_of_two_sockets_gives_the_scale(two_sockets):
    (unsure, apart), (sure, known) = two_sockets(), two_sockets("--spacing", f"P,Q={APART:.4f}±0.005")
    assert sure < 0.5 * unsure
    assert abs(known - APART) < 0.02 < abs(apart - APART)


@pytest.mark.long
def test_the_artefact_file_may_hold_sockets_and_their_distance(two_sockets, cellctl, tmp_path, capsys):
    distances = f"distances: [{{between: [P, Q], mm: {APART:.4f}, sigma: 0.005}}]\n"
    (tmp_path / "plate.yaml").write_text(f"sockets: [{{id: P}}, {{id: Q}}]\n{distances}")
    spaced = two_sockets("--artefact", "plate.yaml")
    assert spaced == two_sockets("--spacing", f"P,Q={APART:.4f}+-0.005")
    assert two_sockets("--artefact", "plate.yaml", "--no-distances") == two_sockets()
    (tmp_path / "plate.yaml").write_text(f"sockets: [{{id: P}}]\n{distances}")
    assert cellctl("fit", "robot.yaml", "data.csv", "--artefact", "plate.yaml") == 2
    assert "no sphere or socket 'Q'" in capsys.readouterr().err


def grown(rng, count=60):
    arm, readings = replace(ARM, growth=3e-5), drawn(rng, count)
    celsius = rng.uniform(15.0, 35.0, count)
    columns = joints_and_places(readings, arm.tcp(readings, celsius) + noise(rng, count))
    return {**columns, "temperature": celsius}


@pytest.mark.long
def test_thermal_expansion_is_identified_and_predicted_at_each_rows_temperature(fitted, cellctl, tmp_path, capsys):
    text = csv_text(grown(np.random.default_rng(7)))
    plain = fitted(text, "--model", "geometry")
    result = fitted(text, "--model", "growth+geometry")
    assert result["model"] == "geometry+growth"
    assert result["test"]["mean"] < 0.03 < 0.05 < plain["test"]["mean"]
    warm = csv_text({**joints(np.array([[10.0, -30.0, -60.0]] * 2)), "temperature": [20.0, 35.0]})
    (tmp_path / "asked.csv").write_text(warm)
    assert cellctl("predict", "m.json", "asked.csv", "-o", "tcp.csv") == 0
    cold, hot = (np.array([float(row[n]) for n in "XYZ"]) for row in csv.DictReader((tmp_path / "tcp.csv").open()))
    true = replace(ARM, growth=3e-5).tcp(np.array([[10.0, -30.0, -60.0]] * 2), np.array([20.0, 35.0]))
    assert hot - cold == pytest.approx(true[1] - true[0], abs=0.05)
    (tmp_path / "bare.csv").write_text("A1,A2,A3\n10,-30,-60\n")
    assert cellctl("predict", "m.json", "bare.csv", "-o", "tcp.csv") == 0
    assert "20 °C" in capsys.readouterr().err


def test_play_is_found_in_the_sense_in_which_the_model_counts(fitted, tmp_path):
    rng = np.random.default_rng(8)
    arm, readings = replace(ARM, play_deg=0.01), drawn(rng, 60)
    upwards = rng.choice([-1.0, 1.0], 60)
    columns = joints_and_places(readings, arm.tcp(readings, upwards=upwards) + noise(rng, 60))
    directions = {"D1": [0.0] * 60, "D2": -upwards, "D3": [""] * 60}  # the shoulder counts downwards
    result = fitted(csv_text({**columns, **directions}), "--model", "geometry+backlash")
    found = {each.name: each for each in ModelFile.load(tmp_path / "m.json").parameters}["backlash2"]
    assert np.degrees(found.value) == pytest.approx(-0.01, abs=4 * np.degrees(found.sigma))
    assert np.degrees(found.sigma) < 0.002
    assert result["test"]["mean"] < 0.03


def test_a_direction_that_is_none_is_named(fitted):
    columns = {**places(np.random.default_rng(9), ARM), "D2": [1.0, 2.0] + [-1.0] * 28}
    assert "D2 is 2" in fitted(csv_text(columns), "--model", "geometry")["rejected"][0]["reason"]


@pytest.mark.long
def test_auto_keeps_what_pays_and_says_what_it_tried(fitted, capsys):
    result = fitted(csv_text(grown(np.random.default_rng(7), 120)))
    steps = {step["model"]: step for step in result["ladder"]}
    assert steps["geometry"]["kept"]
    assert steps["geometry+growth"]["kept"]
    assert steps["geometry"]["error_mm"] - steps["geometry+growth"]["error_mm"] > 0.05
    assert not any("backlash" in model for model in steps)
    assert "growth" in result["model"]
    assert "geometry+growth: kept" in capsys.readouterr().out


@pytest.mark.long
def test_a_models_effects_come_back_from_its_file(fitted, tmp_path):
    columns = grown(np.random.default_rng(7))
    rng = np.random.default_rng(1)
    more = {"D1": rng.choice([-1.0, 1.0], 60), "payload": rng.choice([0.0, 5.0], 60)}
    fitted(csv_text({**columns, **more}), "--model", "geometry+compliance+harmonics+backlash+growth")
    model = ModelFile.load(tmp_path / "m.json")
    again = ModelFile.model_validate(json.loads(model.text()))
    at = Postures(rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), rng.normal(size=5), np.abs(rng.normal(size=5)))
    robot = model.robot_model()
    assert [effect.group for effect in robot.effects] == ["compliance", "harmonics", "backlash", "growth"]
    assert np.array_equal(again.robot_model().tcp(at), robot.tcp(at))
    assert {each.unit for each in model.parameters} == {"mm", "rad", "rad/(N m)", "1/K"}


def test_a_model_file_from_before_effects_and_sessions_still_loads(fitted, tmp_path):
    fitted(csv_text(places(np.random.default_rng(9), ARM)), "--model", "geometry")
    new = json.loads((tmp_path / "m.json").read_text())
    old = {name: value for name, value in new.items() if name not in ("effects", "sessions", "outside_mm")}
    (tmp_path / "old.json").write_text(json.dumps(old))
    q = np.zeros((1, 3))
    loaded = [ModelFile.load(tmp_path / name).robot_model().tcp(q) for name in ("m.json", "old.json")]
    assert np.array_equal(*loaded)


def test_tolerances_of_the_robot_file_hold(fitted, tmp_path):
    (tmp_path / "robot.yaml").write_text(f"{ELBOW_ROBOT}tolerances: {{link_mm: 0.8}}\n")
    fitted(csv_text(places(np.random.default_rng(9), ARM)), "--model", "geometry")
    before = {each.name: each.prior_sigma for each in ModelFile.load(tmp_path / "m.json").parameters}
    assert before["a2"] == 0.8
    assert before["theta2"] == pytest.approx(math.radians(0.05))
