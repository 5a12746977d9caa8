"""Robots with a prismatic joint: a KR 5 on a rail or a lift, one with a quill. Their true motion is computed here.

The truth uses the six revolute joints of `SerialChain` alone. Carriage and quill move by their own formulas, with
errors that no polynomial describes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.formats.description import in_poe
from cellctl.robot_file import RobotFile
from tests.helpers.arms import KR5_FILE, Floats

KINDS = ("rail", "lift", "quill")
TRAVEL_MM = {"rail": 3000.0, "lift": 800.0, "quill": 300.0}
SCALE = 200e-6
REPEATABILITY_MM = 0.03
TRACKER_SIGMA_MM = 0.02
NOISE_MM = float(np.hypot(REPEATABILITY_MM / np.sqrt(3.0), TRACKER_SIGMA_MM))
"""Of a measured position, 1 σ on each axis."""

FLOOR_MM = NOISE_MM * float(np.sqrt(8.0 / np.pi))
"""Mean distance by that noise alone (of a Maxwell distribution)."""

LOW = np.array([-140.0, -150.0, -40.0, -170.0, -110.0, -170.0])
HIGH = np.array([140.0, 20.0, 140.0, 170.0, 110.0, 170.0])
"""Readings of the arm's joints, deg."""


def sliding_robot_text(kind: str) -> str:
    """The robot file (poe) of the KR 5 on a `rail` along X or a `lift` along Z, or with a `quill` along its z6."""
    arm = in_poe(RobotFile.load(KR5_FILE))
    screws = [f"  - {{axis: {list(row.axis)}, point: {list(row.point)}}}" for row in arm.screws]
    joints = [
        f"  - {{sign: {row.sign}, offset: {row.offset}, min: {row.min}, max: {row.max}, max_speed: {row.max_speed}}}"
        for row in arm.joints
    ]
    axis = [0, 0, 1] if kind == "lift" else [1, 0, 0]
    screw = f"  - {{axis: {axis}, point: [0, 0, 0]}}"
    joint = f"  - {{type: prismatic, min: 0, max: {TRAVEL_MM[kind]}, max_speed: 500}}"
    first = kind != "quill"
    lines = [
        f"name: KR 5 on a {kind}" if first else "name: KR 5 with a quill",
        "convention: poe",
        "screws:",
        *([screw, *screws] if first else [*screws, screw]),
        f"home: {{xyz: {list(arm.home.xyz)}, abc: {list(arm.home.abc)}}}",
        "joints:",
        *([joint, *joints] if first else [*joints, joint]),
        f"tool: {{xyz: {list(arm.tool.xyz)}, abc: {list(arm.tool.abc)}}}",
        f"repeatability: {REPEATABILITY_MM}",
    ]
    return "".join(f"{line}\n" for line in lines)


@dataclass(frozen=True, eq=False)
class SlidingRobot:
    """A true KR 5 with a prismatic joint. readings: as in columns A1…A7, mm of that joint."""

    kind: str
    seed: int = 0

    def tcp(self, readings: Floats) -> Floats:
        """True TCP (N, 3), mm, in the frame of an instrument, without noise."""
        first = self.kind != "quill"
        slide, arm = (readings[:, 0], readings[:, 1:]) if first else (readings[:, 6], readings[:, :6])
        robot = in_poe(RobotFile.load(KR5_FILE))
        chain = robot.chain()
        rng = np.random.default_rng(self.seed)
        sizes = np.where(chain.parameter_turns, np.deg2rad(0.04), 0.3)
        sizes[[name.startswith(("base", "tool")) for name in chain.parameters]] = 0.0
        chain = chain.with_parameters(sizes * rng.normal(size=sizes.size))
        q = robot.joint_map().model(arm)
        if first:
            local = chain.forward(q)[:, :3, 3]
            turn, shift = self.carriage(slide)
            in_base = np.einsum("nij,nj->ni", turn, local) + shift
        else:
            flange, along = chain.forward_flange(q), Rotation.from_rotvec([0.002, -0.001, 0.0]).apply([0.0, 0.0, 1.0])
            offset = chain.tool[:3, 3] + (1.0 + SCALE) * slide[:, None] * along
            in_base = np.einsum("nij,nj->ni", flange[:, :3, :3], offset) + flange[:, :3, 3]
        station = Rotation.from_euler("zyx", [35.0, 1.0, -0.5], degrees=True)
        return np.asarray(station.apply(in_base) + np.array([4200.0, -900.0, 650.0]))

    def carriage(self, slide: Floats) -> tuple[Floats, Floats]:
        """Rotation (N, 3, 3) and place (N, 3), mm, of the carriage at readings (N,), mm: tilt, scale, straightness."""
        u, moved = slide / TRAVEL_MM[self.kind], (1.0 + SCALE) * slide
        bend, step = 0.25 * np.exp(-(((u - 0.65) / 0.13) ** 2)), 0.2 * np.tanh((u - 0.4) / 0.1)
        ripple = 0.05 * np.sin(2.0 * np.pi * 2.3 * u + 0.4)
        rotation = 1e-4 * np.stack([np.sin(4.1 * u), np.tanh(3.0 * (u - 0.5)), np.cos(5.0 * u)], axis=1)
        if self.kind == "rail":
            along, across = np.array([1.0, 0.0008, -0.0005]), np.stack([ripple, step, bend], axis=1)
        else:
            along, across = np.array([0.0006, -0.0009, 1.0]), np.stack([step, bend, ripple], axis=1)
        return Rotation.from_rotvec(rotation).as_matrix(), moved[:, None] * along / np.linalg.norm(along) + across

    def rows(self, fit: int, test: int) -> tuple[Floats, Floats, list[str]]:
        """Readings (N, 7), measured TCPs (N, 3), mm, with the noise of robot and tracker, and the set of each row."""
        rng = np.random.default_rng(1000 + self.seed)
        arm = rng.uniform(LOW, HIGH, (fit + test, 6))
        slide = rng.uniform(0.0, TRAVEL_MM[self.kind], (fit + test, 1))
        readings = np.round(np.hstack([slide, arm] if self.kind != "quill" else [arm, slide]), 4)
        measured = self.tcp(readings) + rng.normal(0.0, NOISE_MM, (fit + test, 3))
        return readings, measured, ["fit"] * fit + ["test"] * test


def write_case(
    folder: Path, kind: str, *, seed: int = 0, fit: int = 200, test: int = 100, si: bool = False
) -> tuple[Path, Path]:
    """Robot file and data set of a case, in `folder`. si: columns q1…q7 in m and rad in place of A1…A7."""
    robot, data = folder / f"{kind}.yaml", folder / f"{kind}_{seed}.csv"
    robot.write_text(sliding_robot_text(kind))
    readings, xyz, sets = SlidingRobot(kind, seed).rows(fit, test)
    if si:
        slides = np.arange(7) == (0 if kind != "quill" else 6)
        readings = np.where(slides, readings / 1000.0, np.deg2rad(readings))
    head = ",".join([*(f"{'q' if si else 'A'}{number}" for number in range(1, 8)), "X", "Y", "Z", "set"])
    lines = [
        ",".join([*(f"{value:.8f}" for value in row), *(f"{value:.4f}" for value in place), name])
        for row, place, name in zip(readings.tolist(), xyz.tolist(), sets, strict=True)
    ]
    data.write_text("\n".join([head, *lines]) + "\n")
    return robot, data
