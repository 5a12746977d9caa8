"""What a fit's rows cannot see is said on the screen with its cause, in a few lines; the JSON has all of it."""

import json

import numpy as np
import pytest
from elbow_arm import ROBOT, ElbowArm, csv_text, drawn, joints_and_places

ARM = ElbowArm()


@pytest.fixture
def told(files, cellctl, capsys):
    """Fits positions at readings (N, 3), deg; the lines about what was not seen, and the JSON result."""

    def fit(readings, *options):
        rng = np.random.default_rng(2)
        xyz = ARM.tip(readings) + rng.normal(0.0, 0.01, readings.shape)
        (files / "robot.yaml").write_text(ROBOT)
        (files / "data.csv").write_text(csv_text(joints_and_places(readings, xyz)))
        assert cellctl("fit", "robot.yaml", "data.csv", "--json", "r.json", *options) in (0, 1)
        lines = capsys.readouterr().out.splitlines()
        begin = lines.index("Not seen by these rows:")
        end = next(place for place in range(begin + 1, len(lines)) if not lines[place].startswith("  "))
        return lines[begin + 1 : end], json.loads((files / "r.json").read_text())

    return fit


def test_a_still_joint_is_the_first_line_and_what_harms_nothing_the_last(told):
    readings = drawn(np.random.default_rng(1), 50)
    readings[:, 0] = 20.0
    lines, result = told(readings, "--model", "geometry")
    assert lines[0].startswith("  joint 1 never moves in these rows: ")
    assert lines[-1].startswith(
        "  no row of these kinds can tell apart, and nothing measured so depends on it: θ1 with"
    )
    first, *_, last = result["unseen"]
    assert first["cause"] == "joint 1 never moves in these rows"
    assert (first["harmless"], last["harmless"]) == (False, True)
    hidden = sum(len(each["combinations"]) for each in result["unseen"])
    assert hidden == result["n_parameters"] - result["rank"]
    assert {name for each in result["unseen"] for parts in each["combinations"] for name in parts} > {
        "theta1",
        "base_c",
    }


def test_however_much_is_not_seen_the_screen_has_six_lines_of_it_at_most(told):
    readings = np.tile([20.0, -40.0, -60.0], (30, 1))
    readings[:, 2] += np.linspace(-5.0, 5.0, 30)
    lines, result = told(readings, "--model", "geometry+compliance+harmonics", "--no-check")
    assert result["n_parameters"] - result["rank"] > 12
    assert len(lines) <= 6
    assert max(map(len, lines)) < 300
    assert all(isinstance(words, str) for words in result["unobservable"])
