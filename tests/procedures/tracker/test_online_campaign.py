"""The on-line correction's campaign on devices without wires: which targets, from where to where, and which model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.devices import CorrectionModel, CorrectionReport, CorrectionSample
from cellctl.engine import State
from cellctl.formats import TableFile
from drivers.kuka_rsi.cyclic.online_block import pack
from drivers.kuka_rsi.cyclic.online_model import OnlineModel
from procedures.steps.tracker.rows import CompensatedRow, CorrectionModelRow, PoseRow, TargetsRow, TrackerVerdict
from tests.helpers.steps import CELL, PROCEDURES, ROBOT, FakeRobot, FakeRun, run_fake

PROCEDURE = PROCEDURES / "online_correction.yaml"
SETTINGS: dict[str, Any] = {"targets": 12, "poses_fit": 30, "model": "geometry", "monuments_every": 6}


class CorrectedRobot(FakeRobot):
    """Stands where program and correction put it."""

    model: OnlineModel | None = None
    id = ""

    async def move(self, target: tuple[float, ...], speed_percent: float) -> tuple[float, ...]:
        await super().move(target, speed_percent)
        self.programmed = target
        if self.model:
            for _ in range(3):
                offset = self.model.correction(target)
            self.truth.joints = np.array(target) + offset
        return await self.joints()

    async def programmed_joints(self) -> tuple[float, ...]:
        return self.programmed

    async def correction_on(self, model: CorrectionModel) -> None:
        self.programmed = await self.joints()
        self.model, self.id = OnlineModel(pack(model.arrays)), model.id

    async def correction_off(self) -> CorrectionReport:
        self.model, self.id = None, ""
        self.truth.joints = np.array(self.programmed)
        return CorrectionReport(1, 0, 0, 0, 0, 0)

    def correction_id(self) -> str:
        return self.id

    def correction_samples(self) -> tuple[CorrectionSample, ...]:
        return (CorrectionSample(0, self.programmed, (0.0,) * 6, 1.0),)

    def replace_correction_model(self, model: CorrectionModel) -> None:
        raise NotImplementedError

    async def run_program(self, number: int, limit_s: float) -> tuple[float, ...]:
        raise NotImplementedError


class ModelFileSwapped(CorrectedRobot):
    """Somebody writes another model into the run folder before the second round."""

    folder: Path

    async def correction_off(self) -> CorrectionReport:
        (model,) = self.folder.glob("*/model.json")
        model.write_text(model.read_text().replace("0.1", "0.2"))
        return await super().correction_off()


def limited_to(deg: float, folder: Path) -> Path:
    """The cell with this limit of the on-line correction."""
    text = CELL.read_text().replace("../robots/", f"{ROBOT.parent}/")
    assert "online_correction_deg: 1.5}" in text
    path = folder / f"cell_{deg:g}.yaml"
    path.write_text(text.replace("online_correction_deg: 1.5}", f"online_correction_deg: {deg:g}}}"))
    return path


def ended(folder: Path, deg: float, kind: type[FakeRobot] = CorrectedRobot) -> FakeRun:
    return run_fake(PROCEDURE, folder, SETTINGS, cell=limited_to(deg, folder), kind=kind)


@pytest.fixture(scope="module")
def low(tmp_path_factory: pytest.TempPathFactory) -> FakeRun:
    """A run whose limit some targets need more than."""
    return ended(tmp_path_factory.mktemp("low"), 0.45)


def test_targets_that_need_more_than_the_limit_are_left_out_and_named(low: FakeRun) -> None:
    assert low.outcome.state is State.FINISHED, low.outcome.error
    (made,) = low.journal.recorded(TargetsRow)
    assert 0 < len(made.left_out) < 12
    assert all("is corrected by" in reason for reason in made.reasons)
    assert made.max_correction_deg <= 0.45
    assert low.journal.recorded(TrackerVerdict)[-1].better


def test_the_robot_goes_to_the_nominal_joints_and_from_there_to_the_next_target(low: FakeRun) -> None:
    rows = low.journal.recorded(CompensatedRow)
    table = TableFile.load(low.folder / "table.json").rows
    before = {row.number: row.commanded for row in low.journal.recorded(PoseRow)}
    assert len(rows) == len(table)
    for row in rows:
        assert row.commanded == pytest.approx(table[row.row - 1].nominal, abs=1e-4)
        assert row.commanded == pytest.approx(before[row.number], abs=1e-4)
        assert row.joints == pytest.approx(table[row.row - 1].compensated, abs=0.02)
    assert max(np.linalg.norm(np.subtract(row.joints, row.commanded)) for row in rows) > 0.2


@pytest.mark.long
def test_a_model_file_that_is_swapped_in_mid_run_is_refused_and_nothing_is_corrected_by_it(tmp_path: Path) -> None:
    ModelFileSwapped.folder = tmp_path
    run = ended(tmp_path, 2.0, ModelFileSwapped)
    assert run.outcome.state is State.FAILED
    assert "model.json: has changed since this run wrote it" in str(run.outcome.error)
    assert len(run.journal.recorded(CorrectionModelRow)) == 1
    robot: Any = run.robot
    assert robot.correction_id() == ""
