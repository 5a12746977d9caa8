"""Robots of any number of joints, after either convention; and the shipped robots as they have always been."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cellctl.formats import RobotFile
from cellctl.formats.description import RobotDescription, robot_text
from sims.cell import ERRORS, read_cell
from sims.conditions import Conditions
from sims.robot_file import read_robot
from sims.section import Section
from sims.world import World
from tests.helpers.sims import BENT, CELL, with_errors

CELLS = Path(__file__).parents[3] / "procedures/cells"
HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)


def world(robot, seed=1, **errors):
    return World(with_errors(replace(CELL, robot=robot), **errors), seed)


def step(axis="z", degrees=0.0, along=(0.0, 0.0, 0.0)):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    T[:3, 3] = along
    return T


def rows(count, convention, seed=5):
    """A robot file's content with so many joints, some beside a parallel one."""
    draw = np.random.default_rng(seed)
    links = [
        {
            "theta": float(draw.uniform(-180, 180)),
            "a": float(draw.uniform(-300, 300)),
            "alpha": float(draw.choice([-90.0, 0.0, 90.0])),
            **({"beta": float(draw.uniform(-2, 2))} if i % 3 == 1 else {"d": float(draw.uniform(-300, 300))}),
        }
        for i in range(count)
    ]
    joint = {"sign": -1, "offset": 15, "min": -180, "max": 180, "max_speed": 100}
    return {
        "name": "any",
        "convention": convention,
        "links": links,
        "joints": [joint] * count,
        "base": {"xyz": [10, 20, 30], "abc": [40, 5, 6]},
        "tool": {"xyz": [11, 12, 130], "abc": [10, 20, 30], "mass": 2.0},
        "repeatability": 0.03,
    }


def robot_of(content):
    problems = []
    robot = read_robot(Section(content, "robot.yaml", problems))
    assert problems == []
    return robot


def table_tip(content, readings):
    """Tool's pose by the two conventions' own products of elementary transforms."""
    T = step(along=content["base"]["xyz"]) @ step("ZYX", content["base"]["abc"])
    for link, joint, reading in zip(content["links"], content["joints"], readings, strict=True):
        theta = link["theta"] + joint["sign"] * reading + joint["offset"]
        Rz, Tz = step("z", theta), step(along=(0, 0, link.get("d", 0.0)))
        Tx, Rx, Ry = step(along=(link["a"], 0, 0)), step("x", link["alpha"]), step("y", link.get("beta", 0.0))
        T = T @ (Rz @ Tz @ Tx @ Rx @ Ry if content["convention"] == "mdh-hayati" else Rx @ Tx @ Ry @ Rz @ Tz)
    return T @ step(along=content["tool"]["xyz"]) @ step("ZYX", content["tool"]["abc"])


@pytest.mark.parametrize("convention", ["mdh-hayati", "dh-craig"])
@pytest.mark.parametrize("count", range(1, 9))
@given(data=st.data())
@settings(max_examples=5)
def test_the_tools_pose_is_that_of_the_link_table(convention, count, data):
    content = rows(count, convention)
    readings = data.draw(st.lists(st.floats(-180, 180), min_size=count, max_size=count))
    x, y, z, *abc = world(robot_of(content)).true_pose(readings)
    expected = table_tip(content, readings)
    assert (x, y, z) == pytest.approx(tuple(expected[:3, 3]), abs=1e-8)
    assert Rotation.from_euler("ZYX", abc, degrees=True).as_matrix() == pytest.approx(expected[:3, :3], abs=1e-7)


@pytest.mark.parametrize("count", range(1, 9))
def test_every_error_has_a_draw_for_every_joint(count):
    robot = robot_of(rows(count, "dh-craig"))
    readings = [20.0] * count
    state = Conditions((1,) * count, 40.0, 2.0)
    usual = world(robot).true_tcp(readings, state)
    for kind in ("geometry", "joint_zero", "compliance", "gear", "backlash", "expansion"):
        assert np.all(np.isfinite(moved := world(robot, **{kind: 1}).true_tcp(readings, state)))
        assert moved != usual


def test_a_convention_that_nobody_knows_is_named():
    problems = []
    read_robot(Section({**rows(2, "mdh-hayati"), "convention": "dh"}, "robot.yaml", problems))
    assert problems == ["robot.yaml.convention: mdh-hayati or dh-craig or poe is expected, not 'dh'"]


def test_the_angles_of_the_true_tool_turn_with_the_true_joints():
    robot = world(CELL.robot, joint_zero=1, gear=1)
    here, there = (
        Rotation.from_euler("ZYX", one.true_pose(BENT)[3:], degrees=True) for one in (world(CELL.robot), robot)
    )
    assert 0.005 < np.degrees((here.inv() * there).magnitude()) < 0.5
    assert robot.true_pose(BENT)[:3] == robot.true_tcp(BENT)


# Taken from the program as it was before it knew compliance, gear, backlash and expansion.
BEFORE = [
    ("sphere_cell", 1, HOME, (1104.7195336423845, 50.50224700187089, 654.3305639363182)),
    ("sphere_cell", 1, BENT, (1161.4707105025343, -320.5758828890953, 595.727804853517)),
    ("sphere_cell", 2, HOME, (1101.7619709358955, 47.97388130410176, 648.304227039572)),
    ("sphere_cell", 2, BENT, (1158.4486631689124, -323.3191542694649, 592.2706733462317)),
    ("sphere_cell", 7, HOME, (1103.4306809027066, 51.0414574093629, 648.7818664952235)),
    ("single_sphere_cell", 41, BENT, (1159.3675428060399, -321.63289523548275, 593.2873337849654)),
]


@pytest.mark.parametrize(("name", "seed", "readings", "expected"), BEFORE)
def test_the_shipped_cells_robots_are_what_they_have_always_been(name, seed, readings, expected):
    assert World(read_cell(CELLS / f"{name}.yaml"), seed).true_tcp(readings) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ["kr5_r1400", "ur10", "iiwa14"])
def test_a_robot_given_by_its_axes_is_the_robot_that_its_table_gives(name):
    """The tool is in the same place, whatever bends and warms it. The geometry's own errors are left out: they lie in
    directions across each axis, and among equals rounding chooses which.
    """
    file = CELLS.parent / "robots" / f"{name}.yaml"
    text = robot_text(RobotDescription.of(RobotFile.load(file)), "poe", name)
    table, axes = (read_robot(Section(yaml.safe_load(each), "", [])) for each in (file.read_text(), text))
    assert axes.screws
    assert not axes.links
    every = dict.fromkeys(ERRORS, 1.0) | {"geometry": 0.0}
    for readings in np.random.default_rng(1).uniform(-60.0, 60.0, (5, len(table.joints))).tolist():
        conditions = Conditions(temperature_c=31.0, payload_kg=2.0)
        places = [world(robot, seed=3, **every).true_pose(readings, conditions) for robot in (table, axes)]
        assert places[1] == pytest.approx(places[0], abs=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"screws": []}, "1 joints for 0 screws"),
        ({"home": None}, "home: is missing"),
        ({"screws": [{"axis": [0, 0, 0], "point": [0, 0, 0]}]}, "a direction is expected"),
        ({"screws": [{"axis": [0, 0, 1]}]}, "point: is missing"),
        ({"screws": [{"axis": [0, 0, 1], "point": [0, 0, 0]}] * 2}, "1 joints for 2 screws"),
    ],
)
def test_axes_that_make_no_robot_are_named(change, words):
    problems = []
    robot = {
        "name": "one",
        "convention": "poe",
        "screws": [{"axis": [0, 0, 2], "point": [1, 2, 3]}],
        "home": {"xyz": [1, 2, 3]},
        "joints": [{"min": -9, "max": 9, "max_speed": 1}],
        "repeatability": 0.1,
    }
    read_robot(Section(robot, "", problems))
    assert problems == []
    read_robot(Section({**robot, **change}, "", problems))
    assert any(words in problem for problem in problems), problems
