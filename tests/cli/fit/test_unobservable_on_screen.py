"""The screen shows unobservable parameters with their reasons, in a few lines; the JSON has all of them."""

import json

import numpy as np
import pytest

from tests.helpers.arms import ELBOW_ROBOT, ElbowArm, csv_text, drawn, joints_and_places

ARM = ElbowArm(at=(0.0, 0.0, 0.0))
SPHERES = {"S1": [600.0, -200.0, 300.0], "S2": [600.0, 200.0, 350.0], "S3": [500.0, 0.0, 600.0]}
RADIUS = 30.0


@pytest.fixture
def told(files, cellctl, capsys):
    """Fits positions at readings (N, 3), deg, or touches on spheres; the lines about what was not seen; the JSON."""

    def fit(readings, *options, touched=()):
        xyz = ARM.tcp(readings) + np.random.default_rng(2).normal(0.0, 0.01, readings.shape)
        columns = joints_and_places(readings, xyz)
        if touched:
            joints = {name: columns[name] for name in ("A1", "A2", "A3")}
            columns = {**joints, "sphere": touched, "radius": [RADIUS] * len(touched)}
        (files / "robot.yaml").write_text(ELBOW_ROBOT)
        (files / "data.csv").write_text(csv_text(columns))
        assert cellctl("fit", "robot.yaml", "data.csv", "--json", "r.json", *options) in (0, 1)
        lines = capsys.readouterr().out.splitlines()
        begin = lines.index("Not observable with these rows:")
        end = next(place for place in range(begin + 1, len(lines)) if not lines[place].startswith("  "))
        return lines[begin + 1 : end], json.loads((files / "r.json").read_text())

    return fit


def test_a_still_joint_is_the_first_line_and_what_harms_nothing_the_last(told):
    readings = drawn(np.random.default_rng(1), 50)
    readings[:, 0] = 20.0
    lines, result = told(readings, "--model", "geometry")
    assert lines[0].startswith("  joint 1 never moves in these rows: ")
    assert lines[-1].startswith("  no measurement of these kinds can tell these apart, or depends on them: θ1 with")
    first, *_, last = result["unseen"]
    assert first["cause"] == "joint 1 never moves in these rows"
    assert (first["harmless"], last["harmless"]) == (False, True)
    hidden = sum(len(each["combinations"]) for each in result["unseen"])
    assert hidden == result["n_parameters"] - result["rank"]
    assert {name for each in result["unseen"] for parts in each["combinations"] for name in parts} > {
        "theta1",
        "base_c",
    }


@pytest.mark.long
def test_however_much_is_not_seen_the_screen_has_six_lines_of_it_at_most(told):
    readings = np.tile([20.0, -40.0, -60.0], (30, 1))
    readings[:, 2] += np.linspace(-5.0, 5.0, 30)
    lines, result = told(readings, "--model", "geometry+compliance+harmonics", "--no-check")
    assert result["n_parameters"] - result["rank"] > 12
    assert len(lines) <= 6
    assert max(map(len, lines)) < 300
    assert all(isinstance(words, str) for words in result["unobservable"])


@pytest.mark.parametrize("names", [["S1"], ["S1", "S2", "S3"]], ids=["one", "three"])
def test_touches_all_on_one_sphere_are_reported(told, names):
    """Three joints that touch one sphere hardly move; a robot of six tells as much from one as from three."""
    rng = np.random.default_rng(3)
    touched = [names[row % len(names)] for row in range(30)]
    normals = rng.normal(size=(30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centres = np.array([SPHERES[name] for name in touched])
    lines, _ = told(ARM.reaching(centres + RADIUS * normals, rng), "--model", "geometry", touched=touched)
    assert lines[0].startswith("  all rows are on one sphere: ") == (len(names) == 1)
    assert lines[-1].startswith("  no measurement of these kinds can tell these apart")
