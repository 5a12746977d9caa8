"""Pushing the run's table: what is refused before the controller hears of it, and what it holds afterwards."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cellctl.devices import ControllerTable, DeviceFault, Identity, TableInfo, TableState
from cellctl.files import InputError, load_yaml
from cellctl.formats import RobotFile, TableFile
from cellctl.formats.model import JointRegion
from cellctl.formats.table import Row, TableRobot, TableSource
from procedures.steps.table_push import pushed_row

ROOT = Path(__file__).parents[2]
ROBOT_FILE = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
ROBOT = RobotFile.load(ROBOT_FILE)
HOME = [0.0, -90.0, 90.0, 0.0, 45.0, 0.0]


class Controller:
    """Keeps what is pushed, or something else."""

    def __init__(self, serial: str = "SIM-1", damage: bool = False) -> None:
        self.serial, self.damage = serial, damage
        self.table: ControllerTable | None = None

    async def connect(self) -> Identity:
        return Identity("robot", self.serial, "KR5", "KSS", self.serial.startswith("SIM-"))

    async def push_table(self, table: ControllerTable) -> TableState:
        self.table = table
        return TableState(TableInfo(table.id, len(table.rows), ""), None, None)

    async def read_table(self) -> ControllerTable | None:
        assert self.table is not None
        return replace(self.table, rows=self.table.rows[:-1]) if self.damage else self.table


class Context:
    robot_file = ROBOT_FILE
    cell = load_yaml(ROOT / "procedures" / "cells" / "sphere_cell.yaml")

    def __init__(self, folder: Path) -> None:
        self.run_folder = folder


def table_in(folder: Path, **changes: Any) -> str:
    """A table file of two rows in `folder`; its id."""
    fields: dict[str, Any] = {
        "robot": TableRobot(serial="SIM-1", name=ROBOT.name),
        "simulated": True,
        "tool": ROBOT.tool,
        "source": TableSource(run="run", model_sha256="0" * 64, method="pseudo-target"),
        "joint_region": JointRegion(min=[-100.0] * 6, max=[100.0] * 6),
        "created": "2026-01-01T00:00:00Z",
        **changes,
    }
    rows = [
        Row(
            target=[900.0, 0.0, 600.0, 0.0, 0.0, 0.0],
            nominal=[angle + step for angle in HOME],
            compensated=[angle + step + 0.1 for angle in HOME],
            predicted_before_mm=1.0,
            predicted_after_mm=0.0,
            sigma_mm=0.05,
        )
        for step in (0.0, 1.0)
    ]
    table = TableFile.of(rows, **fields)
    table.save(folder / "table.json")
    return table.id


def push(folder: Path, table_id: str, controller: Controller | None = None) -> dict[str, Any]:
    context: Any = Context(folder)
    robot: Any = controller or Controller()
    return asyncio.run(pushed_row(context, robot, table_id))


def test_a_pushed_table_is_verified_and_active(tmp_path: Path) -> None:
    controller = Controller()
    table_id = table_in(tmp_path)
    row = push(tmp_path, table_id, controller)
    assert row == {
        "id": table_id,
        "rows": 2,
        "pushed": True,
        "verified": True,
        "active": True,
        "max_correction_deg": pytest.approx(0.1),
    }
    assert controller.table is not None
    assert controller.table.rows[1].compensated == pytest.approx([angle + 1.1 for angle in HOME])


@pytest.mark.parametrize(
    ("changes", "serial", "words"),
    [
        ({}, "SIM-2", "SIM-2"),
        ({}, "925185", "simulator"),
        ({"simulated": False}, "SIM-1", "simulator"),
        ({"robot": TableRobot(serial="SIM-1", name="another robot")}, "SIM-1", "another robot"),
        ({"tool": ROBOT.tool.model_copy(update={"xyz": [1.0, 2.0, 3.0]})}, "SIM-1", "tool"),
        ({"joint_region": JointRegion(min=[-100.0] * 6, max=[90.5] * 6)}, "SIM-1", "row 2"),
    ],
)
def test_what_does_not_fit_is_refused_and_the_controller_hears_nothing(
    changes: dict[str, Any], serial: str, words: str, tmp_path: Path
) -> None:
    table_id = table_in(tmp_path, **changes)
    controller = Controller(serial)
    with pytest.raises(InputError, match=words):
        push(tmp_path, table_id, controller)
    assert controller.table is None


def test_a_table_changed_after_the_run_made_it_is_refused(tmp_path: Path) -> None:
    table_id = table_in(tmp_path)
    file = tmp_path / "table.json"
    file.write_text(file.read_text().replace("90.1", "90.2"))
    controller = Controller()
    with pytest.raises(InputError, match="changed"):
        push(tmp_path, table_id, controller)
    assert controller.table is None


def test_another_runs_table_is_refused(tmp_path: Path) -> None:
    table_in(tmp_path)
    controller = Controller()
    with pytest.raises(InputError, match="this run made"):
        push(tmp_path, "f" * 64, controller)
    assert controller.table is None


def test_a_controller_that_holds_something_else_is_a_fault(tmp_path: Path) -> None:
    with pytest.raises(DeviceFault, match="not table"):
        push(tmp_path, table_in(tmp_path), Controller(damage=True))
