"""Fits of simulated robots with all that a report is made from, and an HTML page as a test reads it."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np

from cellctl.calibration import (
    PoseRows,
    PositionRows,
    Session,
    SocketRows,
    SpacingRows,
    Split,
    Task,
    TouchRows,
    fit,
)
from cellctl.formats import RobotFile, nominal_model
from cellctl.kinematics import pose, pose_from_xyz_abc
from cellctl.planning.next_rows import led_to
from cellctl.report.fit import FitStory

KR5 = RobotFile.load(Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml")
ERRORS = {"theta2": 0.001, "theta3": -0.0008, "a2": 0.6, "d4": -0.5, "alpha1": 0.0005}
REGION = np.array([[-40, -95, 55, -70, 20, -90], [40, -45, 105, 70, 85, 90]], float)
CENTRES = np.array([[950.0, -350.0, 250.0], [950.0, 350.0, 250.0], [1150.0, 0.0, 400.0]])
REACH, SIGMA = 31.3, 0.03
INSTRUMENT = pose_from_xyz_abc([1500.0, -800.0, 300.0], [40.0, 3.0, -2.0])

VOID = {"meta", "br", "img", "link", "input", "hr"}


def truth(robot: RobotFile = KR5, errors=ERRORS):
    nominal = nominal_model(robot, touched=False)
    return nominal.with_deviations([errors.get(name, 0.0) for name in nominal.names])


def postures(count: int, seed: int = 0, robot: RobotFile = KR5, region=REGION):
    return robot.joint_map().model(np.random.default_rng(seed).uniform(*region, (count, robot.n)))


def positions(count: int, seed: int = 0, robot: RobotFile = KR5, region=REGION, true=None, place=INSTRUMENT, **errors):
    q = postures(count, seed, robot, region)
    seen = (true or truth(robot)).on(place, np.eye(4) if robot is not KR5 else truth().chain.tool)
    xyz = seen.tcp(q) + np.random.default_rng(seed + 100).normal(0.0, SIGMA, (count, 3))
    return replace(PositionRows(q, xyz, np.full((count, 3), SIGMA)), **errors)


def poses(count: int, seed: int = 0):
    rows = positions(count, seed)
    model = truth().on(INSTRUMENT, truth().chain.tool)
    turns = model.pose(rows.q)[:, :3, :3]
    sigma = np.hstack([rows.sigma, np.full((count, 3), 1e-4)])
    noise = np.random.default_rng(seed + 7).normal(0.0, 1e-4, (count, 3))
    small = np.eye(3) - np.cross(noise[:, None, :], np.eye(3))
    left, _, right = np.linalg.svd(small)
    return PoseRows(rows.q, pose(left @ right @ turns, rows.xyz), sigma)


def at_points(count: int, away: float, seed: int = 0):
    """Postures and points of a tip `away` mm from the centres, noise included."""
    rng = np.random.default_rng(seed)
    point = np.arange(4 * count) % len(CENTRES)
    start = KR5.joint_map().model(rng.uniform([-15, -75, 70, -60, 30, -90], [15, -50, 100, 60, 80, 90], (4 * count, 6)))
    start[:, 0] += np.arctan2(CENTRES[point, 1], CENTRES[point, 0])
    normal = rng.normal(size=(4 * count, 3)) * 0.6 + [0.0, 0.0, 0.8]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    noise = rng.normal(0.0, SIGMA, (4 * count, 1)) * normal if away else rng.normal(0.0, SIGMA, (4 * count, 3))
    q, there = led_to(truth(), start, CENTRES[point] + away * normal + noise)
    chosen = np.flatnonzero(there)[:count]
    return q[chosen], point[chosen]


def touches(count: int, seed: int = 0):
    q, point = at_points(count, REACH, seed)
    return TouchRows(q, point, np.full(count, REACH), np.full((count, 1), SIGMA))


def sockets(count: int, seed: int = 0):
    q, point = at_points(count, 0.0, seed)
    return SocketRows(q, point, np.full((count, 3), SIGMA))


def spacings():
    pairs = np.array([[0, 1], [1, 2]])
    apart = np.linalg.norm(CENTRES[pairs[:, 0]] - CENTRES[pairs[:, 1]], axis=1)
    return SpacingRows(pairs, apart, np.full((2, 1), 0.01))


def pointed(rows, **settings):
    return Task(
        nominal_model(KR5, touched=False),
        rows,
        ("S1", "S2", "S3"),
        CENTRES + 1.0,
        **{"spacings": spacings(), **settings},
    )


def measured(rows, robot: RobotFile = KR5, **settings):
    return Task(nominal_model(robot, touched=False), rows, **settings)


def told(task: Task, held_out: float = 0.25, split: Split | None = None, robot: RobotFile = KR5, **said):
    """The story of a fit of `task`, its rows' lines counted from 2."""
    split = split or (
        Split.holdout(len(task.rows), held_out, 1) if held_out else Split.by_column(np.zeros(len(task.rows), bool))
    )
    result = fit(task, split)
    lines = tuple(range(2, 2 + len(task.rows)))
    words = {
        "sentence": f"Verdict: {result.verdict}.",
        "outliers": [{"line": lines[row], "reason": "left out"} for row in result.identification.outliers],
        "test_outliers": [{"line": lines[row], "reason": "wild"} for row in result.unpredicted],
        "rejected": [],
    }
    return FitStory(
        robot=robot,
        task=task,
        result=result,
        split=split,
        readings=robot.joint_map().readings(task.rows.q),
        lines=lines,
        said={**words, **said},
    )


def arm(joints: int) -> RobotFile:
    """A robot of so many joints, each across the one before it."""
    links = [{"d": 200.0 + 20.0 * k, "a": 150.0, "alpha": 90.0 if k % 2 else -90.0} for k in range(joints)]
    joint = {"min": -170.0, "max": 170.0, "max_speed": 100.0}
    content = {"name": f"{joints} joints", "convention": "mdh-hayati", "links": links, "joints": [joint] * joints}
    return RobotFile.model_validate({**content, "tool": {"xyz": [30.0, 20.0, 150.0]}, "repeatability": 0.05})


def sessions(count: int):
    """Positions in two sessions, the instrument set up anew for the second; and touches in the first."""
    moved = pose_from_xyz_abc([-900.0, 1200.0, 100.0], [-70.0, 1.0, 4.0])
    second = replace(positions(count, 5, place=moved), session=1)
    blocks = [touches(count, 3), second]
    return pointed(blocks, sessions=(Session("cell"), Session("tracker", frozenset({"base", "tool"}))))


class Page(HTMLParser):
    """Texts, ids, and what is fetched; fails where tags do not match."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.fetched, self.tags, self.open, self.texts = [], [], set(), [], []
        self.feed(text)
        assert not self.open, f"left open: {self.open}"

    def handle_starttag(self, tag, attributes):
        self.handle_startendtag(tag, attributes)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.tags.add(tag)
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "action", "data") and not value.startswith("#"):
                self.fetched.append(value)

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] != "style":
            self.texts.append(data)

    @property
    def text(self):
        return re.sub(r"\s+", " ", " ".join(self.texts))
