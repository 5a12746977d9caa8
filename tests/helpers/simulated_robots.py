"""Paths of a controller's own program under on-line correction: how far the true TCP is from the nominal path.

The task of the RSI process answers the simulated controller's telegrams in this process; its time stands still
meanwhile, so that the World tells where the TCP truly is at every telegram.
"""

from __future__ import annotations

import csv
import os
import select
from dataclasses import dataclass
from functools import cache
from typing import Any, final

import numpy as np

import cellctl
from cellctl.formats import ModelFile
from cellctl.formats.online import CorrectionFile
from cellctl.formats.table_making import nominal_chain
from cellctl.kinematics import Floats, inverse
from drivers.kuka_rsi.cyclic.limits import OnlineLimits
from drivers.kuka_rsi.cyclic.online_block import pack
from drivers.kuka_rsi.cyclic.online_correction import OnlineCorrection
from drivers.kuka_rsi.cyclic.online_model import OnlineModel
from drivers.kuka_rsi.cyclic.session import Admission, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import SharedBlock
from drivers.kuka_rsi.cyclic.telegram import read_telegram
from tests.helpers.corrected_cells import HEAVY_CELL, true_places, true_world
from tests.helpers.runs import ROOT

STEP_MS = 12
LIMITS = OnlineLimits(online_correction_deg=1.5)
_ACCELERATION_MM_S2 = 1000.0
_CENTRE = np.array([2000.0, 200.0, 0.0])
_ROBOT = ROOT / "procedures" / "papers" / "robots" / "kr300_with_end_effector.yaml"
_POSES = ROOT / "procedures" / "papers" / "targets" / "heavy_robot.csv"


@cache
def identified(seed: int = 1) -> ModelFile:
    """The heavy robot of a seed, identified from the true places of the paper's poses."""
    poses = _poses()
    true = true_places(true_world(HEAVY_CELL, seed), poses)
    columns = {f"A{axis}": poses[:, axis - 1] for axis in range(1, 7)} | {
        name: true[:, i] for i, name in enumerate("XYZ")
    }
    return cellctl.fit(_ROBOT, columns, model="geometry+compliance+harmonics", folds=2).file


def _poses() -> Floats:
    rows = [row for row in csv.DictReader(_POSES.open()) if row["set"] == "fit"]
    return np.array([[float(row[f"A{axis}"]) for axis in range(1, 7)] for row in rows])[:160]


def outline(shape: str) -> Floats:
    """The points (N, 2), mm, of a circle of 150 mm radius, or of a U of 300 mm with rounded corners, 1 mm apart."""
    if shape == "circle":
        angle = np.linspace(0.0, 2.0 * np.pi, 943)
        return 150.0 * np.column_stack([np.cos(angle) - 1.0, np.sin(angle)])
    turn = np.linspace(0.0, np.pi / 2, 64)
    corner = 40.0 * np.column_stack([np.sin(turn), 1.0 - np.cos(turn)])
    down = np.column_stack([np.linspace(0.0, 260.0, 261), np.zeros(261)])
    across = np.column_stack([np.full(221, 300.0), np.linspace(40.0, 260.0, 221)])
    first = down[-1] + corner
    second = across[-1] + np.column_stack([corner[:, 1] * -1.0, corner[:, 0]])
    up = np.column_stack([np.linspace(260.0, 0.0, 261), np.full(261, 300.0)])
    return np.concatenate([down, first[1:], across[1:], second[1:], up[1:]])


@final
@dataclass(frozen=True, eq=False)
class Path:
    """A path: joints (N, 6), deg, in steps of `STEP_MS`, and the nominal TCP along it (M, 3), mm, model's frame."""

    joints: Floats
    places: Floats

    @classmethod
    def of(cls, shape: str, speed_mm_s: float, model: ModelFile) -> Path:
        """At a speed, from standstill to standstill, in the y–z plane before the robot, the orientation held."""
        chain, joints = nominal_chain(model), model.robot.joint_map()
        poses = joints.model(_poses())
        first = poses[np.argmin(np.linalg.norm(chain.forward(poses)[:, :3, 3] - _CENTRE, axis=1))]
        points = outline(shape)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        gone = _gone(length[-1], speed_mm_s)
        targets = np.tile(chain.forward(first), (len(gone), 1, 1))
        base = chain.base_now[:3, :3]
        targets[:, :3, 3] += np.interp(gone, length, points[:, 0])[:, None] * base[:, 2]
        targets[:, :3, 3] += np.interp(gone, length, points[:, 1])[:, None] * base[:, 1]
        found = inverse(chain, targets, np.tile(first, (len(gone), 1)))
        assert found.converged.all()
        return cls(joints.readings(found.q), targets[:, :3, 3])


def _gone(length: float, speed: float) -> Floats:
    """Way in each step: the speed rises and falls as half a cosine."""
    ramp_s = np.pi * speed / (2.0 * _ACCELERATION_MM_S2)
    total_s = length / speed + ramp_s
    time = np.arange(0.0, total_s + STEP_MS / 1000, STEP_MS / 1000)

    def begun(t: Floats) -> Floats:
        t = np.clip(t, 0.0, None)
        rising = speed * (t - ramp_s / np.pi * np.sin(np.pi * t / ramp_s)) / 2.0
        return np.where(t < ramp_s, rising, speed * (t - ramp_s / 2.0))

    return np.where(time < total_s / 2, begun(time), length - begun(total_s - time))


@final
@dataclass(frozen=True, eq=False)
class Travelled:
    """N telegrams on the way: time (N,), s; true TCP (N, 3), mm, in the model's frame; programmed and actual joints
    (N, 6), deg.
    """

    time: Floats
    places: Floats
    programmed: Floats
    joints: Floats

    def deviation(self, path: Path) -> Floats:
        """Distance (N,) of the true TCP from the nominal path, mm."""
        start, along = path.places[:-1], np.diff(path.places, axis=0)
        keep = np.linalg.norm(along, axis=1) > 1e-6
        start, along = start[keep], along[keep]
        away = self.places[:, None] - start
        share = np.clip(np.sum(away * along, axis=2) / np.sum(along**2, axis=1), 0.0, 1.0)
        return np.asarray(np.linalg.norm(away - share[..., None] * along, axis=2).min(axis=1))


@final
@dataclass(frozen=True, slots=True)
class Lag:
    """By how much the correction in effect lags behind the model's: ms, and the greatest shift of the TCP by it, mm."""

    ms: float
    mm: float


def lag_of(way: Travelled, model: ModelFile) -> Lag:
    """The delay that explains best the correction in effect, by least squares over 0 … 80 ms."""
    correction = OnlineModel(pack(CorrectionFile.of(model).arrays))
    for _ in range(3):
        correction.correction(way.programmed[0].tolist())
    wanted = np.array([correction.correction(row.tolist()) for row in way.programmed])
    actual = way.joints - way.programmed
    delays = np.arange(0.0, 0.08, 0.001)
    late = [np.stack([np.interp(way.time - each, way.time, axis) for axis in wanted.T], axis=1) for each in delays]
    best = int(np.argmin([np.sum((actual - each) ** 2) for each in late]))
    chain, joints = nominal_chain(model), model.robot.joint_map()
    ends = [chain.forward(joints.model(way.programmed + each))[:, :3, 3] for each in (wanted, actual)]
    return Lag(1000.0 * delays[best], float(np.linalg.norm(ends[0] - ends[1], axis=1).max()))


def travel(pc: Any, path: Path, model: ModelFile, *, corrected: bool) -> Travelled:
    """Run `path` as the own program of the controller on the bench `pc`, RSI on, with the correction or with none."""
    pc.krc.take_program({"number": 1, "every_ms": STEP_MS, "joints": path.joints.tolist()})
    assert pc.ptp(path.joints[0], 50.0)[1] == 0
    block, memory = SharedBlock.create()
    os.close(memory)
    if corrected:
        block.online.place_model(pack(CorrectionFile.of(model).arrays))
    task = OnlineCorrection(SearchOrder(1, tuple(path.joints[0]), (0.0,) * 6, 1.0, (0,) * 8), LIMITS, block.online)
    pc.put('<Cmd Id="8" Op="CORRON"></Cmd>')
    _answer(pc, task, lambda seen, replies: seen >= 1000)
    pc.put('<Cmd Id="9" Op="OWN"><Row N="1"/></Cmd>')
    rows = _answer(pc, task, lambda seen, replies: 'Id="9"' in replies)
    pc.put('<Cmd Id="10" Op="HALT"></Cmd>')
    _answer(pc, task, lambda seen, replies: 'Id="10"' in replies)
    pc.stream = b""
    time, places, programmed, joints = (np.array(column) for column in zip(*rows, strict=True))
    return Travelled(time, places, programmed, joints)


def _answer(pc: Any, task: OnlineCorrection, done: Any) -> list[tuple[float, Any, Any, Any]]:
    """Answer telegrams until `done(telegrams, documents)`; time, true TCP, programmed and actual joints of each."""
    rows: list[tuple[float, Any, Any, Any]] = []
    pc.stream = b""
    while not done(len(rows), "".join(part for part in pc.stream.decode().split("<Stat") if "<Rep" in part)):
        ready, _, _ = select.select([pc.udp, pc.tcp], [], [], 60.0)
        assert ready, "neither telegram nor reply"
        if pc.tcp in ready:
            pc.stream += pc.tcp.recv(65536)
        if pc.udp in ready:
            text = pc.telegram()
            telegram, now = read_telegram(text.encode()), pc.kernel.now
            assert task.admit(telegram) is Admission.ANSWERABLE
            rows.append((now * 1e-9, pc.scene.arm.tcp(now), telegram.programmed, telegram.joints))
            correction, _ = task.answer(telegram, now, False, [0] * 8)
            pc.answer(text, correction)
    return rows
