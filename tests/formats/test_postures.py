"""A cell file's postures: for this robot, or refused with the place and the cure."""

import pytest

from cellctl.files import InputError, load_yaml
from cellctl.formats import RobotFile, postures_of


@pytest.fixture
def read(request, tmp_path):
    robot = RobotFile.load(request.config.rootpath / "procedures/robots/kr5_r1400.yaml")

    def of(text):
        (tmp_path / "cell.yaml").write_text(text)
        return postures_of(load_yaml(tmp_path / "cell.yaml"), robot, "touch")

    return of


def refusal(read, text):
    with pytest.raises(InputError) as caught:
        read(text)
    return str(caught.value)


def test_home_and_touch_are_read_in_degrees(read):
    postures = read("postures: {home: [0, -90, 90, 0, 45, 0], touch: [[0, -60, 90, 0, 60.5, 0]]}\n")
    assert postures.home == [0.0, -90.0, 90.0, 0.0, 45.0, 0.0]
    assert postures.touch == [[0.0, -60.0, 90.0, 0.0, 60.5, 0.0]]


@pytest.mark.parametrize(
    ("text", "place", "what"),
    [
        ("name: x\n", "cell.yaml:1", "'postures' is missing"),
        ("postures:\n  home: [0, -90, 90, 0, 45, 0]\n", "cell.yaml:", "touch"),
        ("postures:\n  home: [0, -90]\n  touch: [[0, 0, 0, 0, 0, 0]]\n", "cell.yaml:2", "2 joint readings for a robot"),
        (
            "postures:\n  home: [0, 0, 0, 0, 0, 0]\n  touch:\n    - [0, 90, 0, 0, 0, 0]\n",
            "cell.yaml:4",
            "A2 90 is outside -180…65°",
        ),
        ("postures:\n  home: [0, 0, 0, 0, 0, 0]\n  touch: []\n", "cell.yaml:3", ""),
    ],
)
def test_what_this_robot_cannot_take_is_refused_where_it_is_written(read, text, place, what):
    said = refusal(read, text)
    assert place in said
    assert what in said


def test_a_posture_from_which_axes_are_turned_is_read_and_checked_where_it_is_needed(request, tmp_path):
    robot = RobotFile.load(request.config.rootpath / "procedures/robots/kr5_r1400.yaml")

    def read(text):
        (tmp_path / "cell.yaml").write_text(text)
        return postures_of(load_yaml(tmp_path / "cell.yaml"), robot, "turn").turn

    home = "postures:\n  home: [0, -90, 90, 0, 45, 0]\n"
    assert read(home + "  turn: [-47, -76, 106, 4, 90, 89]\n") == [-47.0, -76.0, 106.0, 4.0, 90.0, 89.0]
    assert "A2 90 is outside" in refusal(read, home + "  turn: [0, 90, 0, 0, 0, 0]\n")
    assert "there are no postures 'turn'" in refusal(read, home)
