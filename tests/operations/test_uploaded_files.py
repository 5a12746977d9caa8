"""Files that are dropped together are told apart by their names and beginnings."""

from __future__ import annotations

import pytest

from cellctl.files import InputError
from cellctl.operations.analyses import roles

ROBOT = "name: arm\nconvention: poe\njoints:\n"
SPHERES = "spheres:\n  - {id: S1, diameter: 60}\n"


def test_a_single_file_is_the_data_file() -> None:
    assert roles({"rows.csv": "A1,A2,X,Y,Z\n"}) == {"data": "rows.csv"}


def test_robot_file_and_artefact_are_recognised_by_their_content() -> None:
    found = roles({"one.yaml": SPHERES, "two.yml": ROBOT, "rows.csv": "A1,A2,sphere\n"})
    assert found == {"data": "rows.csv", "robot": "two.yml", "artefact": "one.yaml"}


def test_a_urdf_is_the_robot() -> None:
    assert roles({"arm.URDF": "<?xml version='1.0'?>", "rows.csv": "A1,A2"}) == {
        "data": "rows.csv",
        "robot": "arm.URDF",
    }


@pytest.mark.parametrize("joints", ["DECL E6AXIS XP1={A1 1,A2 2}", "name;J1;J2", "q1,q2"])
def test_the_file_with_joints_is_the_data_file_of_two(joints: str) -> None:
    found = roles({"a.txt": "name;X;Y;Z\n", "b.dat": joints})
    assert found == {"data": "b.dat", "positions": "a.txt"}


@pytest.mark.parametrize(
    ("heads", "what"),
    [
        ({"arm.yaml": ROBOT}, "there is no data file"),
        ({"a.yaml": ROBOT, "b.yaml": ROBOT, "c.csv": "A1"}, "there are two robot files"),
        ({"a.csv": "A1", "b.csv": "X", "c.csv": "X"}, "more than two data files"),
    ],
)
def test_other_sets_of_files_are_refused(heads: dict[str, str], what: str) -> None:
    with pytest.raises(InputError, match=what):
        roles(heads)
