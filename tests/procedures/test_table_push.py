"""The run's table: what is refused, what is in force afterwards, and that an unproved one is taken back."""

from __future__ import annotations

import asyncio
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cellctl.devices import (
    ControllerTable,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    HostTables,
    HostTableStore,
    TableInfo,
    TableState,
)
from cellctl.files import InputError, load_yaml
from cellctl.formats import RobotFile, TableFile
from cellctl.formats.table import Row as TargetRow
from cellctl.formats.table import TableRegion, TableRobot, TableSource
from cellctl.operations.results import as_json
from cellctl.operations.table_history import TableHistory
from cellctl.records import Figures, Row, TablePushRow, TableStateRow
from procedures.steps.sphere._proving import PushInputs, push
from procedures.steps.sphere.rows import StandOffFigures
from procedures.steps.table_push import pushed_row, require_in_force, take_back_unproved
from tests.helpers.steps import Context, sphere_verdict

ROOT = Path(__file__).parents[2]
ROBOT_FILE = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
ROBOT = RobotFile.load(ROBOT_FILE)
HOME = [0.0, -90.0, 90.0, 0.0, 45.0, 0.0]


@pytest.fixture
def tmp_path(tmp_path: Path) -> Path:
    """A run folder, in a folder of runs of its own: the history of tables is beside it."""
    folder = tmp_path / "runs" / "run"
    folder.mkdir(parents=True)
    return folder


class Controller:
    """Keeps what is pushed, or something else; `lost`: it does not answer any more."""

    name = "robot"

    def __init__(self, serial: str = "SIM-1", damage: bool = False) -> None:
        self.serial, self.damage = serial, damage
        self.table: ControllerTable | None = None
        self.previous: ControllerTable | None = None
        self.lost = False
        self.asked: list[str] = []

    async def push_table(self, table: ControllerTable) -> TableState:
        self._hear("push")
        self.table, self.previous = table, self.table
        return self._state()

    async def table_state(self) -> TableState:
        self._hear("state")
        return self._state()

    async def read_table(self) -> ControllerTable | None:
        self._hear("read")
        assert self.table is not None
        return replace(self.table, rows=self.table.rows[:-1]) if self.damage else self.table

    async def rollback_table(self) -> TableState:
        self._hear("rollback")
        self.table, self.previous = self.previous, self.table
        return self._state()

    def _hear(self, what: str) -> None:
        self.asked.append(what)
        if self.lost:
            raise DeviceLost("robot", "nothing heard from the controller for 2.1 s")

    def _state(self) -> TableState:
        infos = [TableInfo(table.id, len(table.rows), "") if table else None for table in (self.table, self.previous)]
        return TableState(infos[0], infos[1], None)


CELL = load_yaml(ROOT / "procedures" / "cells" / "sphere_cell.yaml")


def run_of(folder: Path, robot: Controller, *rows: Row) -> Any:
    """A run in which every row counts, on the cell whose robot is `robot`."""
    return Context(list(rows), folder, robot, robot.serial, robot_file=ROBOT_FILE, cell=CELL)


def table_in(folder: Path, **changes: Any) -> str:
    """A table file of two rows in `folder`; its id."""
    fields: dict[str, Any] = {
        "robot": TableRobot(serial="SIM-1", name=ROBOT.name),
        "simulated": True,
        "tool": ROBOT.tool,
        "source": TableSource(run="run", model_sha256="0" * 64, method="pseudo-target"),
        "joint_region": TableRegion(min=[-100.0] * 6, max=[100.0] * 6),
        "created": "2026-01-01T00:00:00Z",
        **changes,
    }
    rows = [
        TargetRow(
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


def pushed(folder: Path, table_id: str, controller: Controller | None = None) -> TableStateRow:
    robot: Any = controller or Controller()
    return asyncio.run(pushed_row(run_of(folder, robot), robot, table_id))


def test_a_pushed_table_is_verified_and_active(tmp_path: Path) -> None:
    controller = Controller()
    table_id = table_in(tmp_path)
    row = pushed(tmp_path, table_id, controller)
    assert row.max_correction_deg == pytest.approx(0.1)
    assert row == TableStateRow(table_id, 2, True, True, True, row.max_correction_deg)
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
        ({"joint_region": TableRegion(min=[-100.0] * 6, max=[90.5] * 6)}, "SIM-1", "row 2"),
    ],
)
def test_what_does_not_fit_is_refused_and_the_controller_hears_nothing(
    changes: dict[str, Any], serial: str, words: str, tmp_path: Path
) -> None:
    table_id = table_in(tmp_path, **changes)
    controller = Controller(serial)
    with pytest.raises(InputError, match=words):
        pushed(tmp_path, table_id, controller)
    assert controller.table is None


def test_a_table_changed_after_the_run_made_it_is_refused(tmp_path: Path) -> None:
    table_id = table_in(tmp_path)
    file = tmp_path / "table.json"
    file.write_text(file.read_text().replace("90.1", "90.2"))
    controller = Controller()
    with pytest.raises(InputError, match="changed"):
        pushed(tmp_path, table_id, controller)
    assert controller.table is None


def test_another_runs_table_is_refused(tmp_path: Path) -> None:
    table_in(tmp_path)
    controller = Controller()
    with pytest.raises(InputError, match="this run made"):
        pushed(tmp_path, "f" * 64, controller)
    assert controller.table is None


def test_a_controller_that_holds_something_else_is_a_fault(tmp_path: Path) -> None:
    with pytest.raises(DeviceFault, match=r"another table is in force than was pushed: .* 1 rows, the file's has 2"):
        pushed(tmp_path, table_in(tmp_path), Controller(damage=True))


OLD = ControllerTable("old" * 8, "SIM-1", ())
PUSHED = TableStateRow("mine" * 8, 2, True, True, True, 0.1)
BEGUN = TablePushRow(PUSHED.id, 2, False, False, None, 0.1)
MINE = ControllerTable(PUSHED.id, "SIM-1", ())
STANDOFF = StandOffFigures(Figures(1.0, 1.0, 1.0), Figures(0.1, 0.1, 0.1), 30, "P1", 0.1, 0.1)
BETTER = sphere_verdict(standoff=STANDOFF, table=PUSHED)


def controller_with(active: ControllerTable | None, previous: ControllerTable | None) -> Controller:
    controller = Controller()
    controller.table, controller.previous = active, previous
    return controller


def withdrawn(folder: Path, controller: Any, *rows: Row) -> Any:
    context = run_of(folder, controller, *rows)
    asyncio.run(take_back_unproved(context, controller))
    return context


def test_a_run_that_is_cut_off_in_the_push_has_said_which_table_may_be_in_force(tmp_path: Path) -> None:
    table_id, controller = table_in(tmp_path), Controller()
    context = run_of(tmp_path, controller)

    async def cut_off(table: ControllerTable) -> TableState:
        raise DeviceUncertain("robot", "uncertain which table is in force")

    controller.push_table = cut_off  # type: ignore[method-assign]
    with pytest.raises(DeviceUncertain):
        asyncio.run(push(context, PushInputs(table=table_id)))
    assert [(row.id, row.active) for row in context.recorded(TablePushRow)] == [(table_id, None)]
    assert context.recorded(TableStateRow) == []


def test_a_table_in_force_already_is_not_pushed_again_and_a_rollback_leads_to_the_one_before(tmp_path: Path) -> None:
    table_id, controller = table_in(tmp_path), controller_with(OLD, None)
    assert pushed(tmp_path, table_id, controller) == pushed(tmp_path, table_id, controller)
    assert controller.asked.count("push") == 1
    withdrawn(tmp_path, controller, replace(PUSHED, id=table_id))
    assert controller.table == OLD


def test_a_table_that_was_judged_is_not_pushed_by_a_resumed_run(tmp_path: Path) -> None:
    controller = Controller()
    context = run_of(tmp_path, controller, replace(BETTER, verdict="worse"))
    assert not asyncio.run(push(context, PushInputs(table=table_in(tmp_path)))).active
    assert controller.asked == []


@pytest.mark.parametrize("rows", [[PUSHED], []], ids=["after the push", "in the push"])
@pytest.mark.parametrize("before", [OLD, None], ids=["a table before", "none before"])
def test_an_unproved_table_is_taken_back_and_what_was_in_force_before_is_so_again(
    rows: list[Row], before: ControllerTable | None, tmp_path: Path
) -> None:
    controller = controller_with(MINE, before)
    held_out = sphere_verdict()  # of the held-out touches: no proof of the table
    context = withdrawn(tmp_path, controller, BEGUN, *rows, held_out)
    assert controller.table == before
    assert context.recorded(TableStateRow)[-1].active is False
    assert "not proved and no longer in force" in context.said[0]


def test_a_push_that_never_came_to_its_end_and_left_the_old_table_in_force_is_not_rolled_back(tmp_path: Path) -> None:
    controller = controller_with(OLD, None)
    context = withdrawn(tmp_path, controller, BEGUN)
    assert controller.table == OLD
    assert context.recorded(TableStateRow)[-1].active is False


@pytest.mark.parametrize(
    "rows",
    [[], [PUSHED, BETTER], [PUSHED, replace(PUSHED, active=False)]],
    ids=["nothing pushed", "proved", "taken back already"],
)
def test_a_controller_is_not_asked_where_no_unproved_table_can_be_in_force(rows: Any, tmp_path: Path) -> None:
    controller = controller_with(MINE, OLD)
    withdrawn(tmp_path, controller, *rows)
    assert controller.asked == []


def test_a_table_that_cannot_be_taken_back_is_named_as_uncertain(tmp_path: Path) -> None:
    controller = controller_with(MINE, OLD)
    controller.lost = True
    context = run_of(tmp_path, controller, PUSHED)
    robot: Any = controller
    with pytest.raises(DeviceUncertain, match=r"table mineminemine was pushed.*may still be in force.*nothing heard"):
        asyncio.run(take_back_unproved(context, robot))
    assert context.recorded(TableStateRow)[-1].active is None


def test_a_table_in_both_places_of_the_controller_is_not_said_to_be_out_of_force(tmp_path: Path) -> None:
    with pytest.raises(DeviceUncertain, match="still in force after one rollback"):
        withdrawn(tmp_path, controller_with(MINE, MINE), PUSHED)


def test_the_rows_of_another_table_are_not_driven_to() -> None:
    robot: Any = controller_with(MINE, OLD)
    asyncio.run(require_in_force(robot, MINE.id))
    robot.table = OLD
    with pytest.raises(DeviceRefused, match="not in force; nothing was moved"):
        asyncio.run(require_in_force(robot, MINE.id))


def history_of(run_folder: Path) -> list[dict[str, Any]]:
    """The changes in the history beside the run folder, oldest first."""
    entries, problems = TableHistory(run_folder.parent, "SIM-1").read()
    assert problems == []
    return [as_json(entry.shown) for entry in entries]


def test_a_table_that_a_run_pushes_and_takes_back_is_in_the_history_with_the_run_and_the_reason(tmp_path: Path) -> None:
    table_id, controller = table_in(tmp_path), controller_with(OLD, None)
    pushed(tmp_path, table_id, controller)
    withdrawn(tmp_path, controller, replace(PUSHED, id=table_id))
    push_, back = history_of(tmp_path)
    assert {change["who"].partition("@")[0] for change in (push_, back)} == {"Ada"}, "the operator of the run"
    assert (push_["action"], push_["run"], push_["source_run"], push_["table"]) == ("push", "run", "run", table_id)
    assert (push_["replaced"], push_["rows"], push_["method"]) == (OLD.id, 2, "pseudo-target")
    assert push_["out_of_force"].startswith("withdrawal, back to oldoldoldold by run run: the run ended")
    assert (back["action"], back["table"], back["reason"]) == (
        "withdrawal",
        OLD.id,
        "the run ended before it was proved",
    )


def test_the_table_of_a_run_survives_the_run_folder(tmp_path: Path) -> None:
    table_id = pushed(tmp_path, table_in(tmp_path)).id
    shutil.rmtree(tmp_path)
    assert TableHistory(tmp_path.parent, "SIM-1").table(table_id).id == table_id


def test_a_push_that_was_cut_off_is_uncertain_until_the_clean_up_has_asked_the_controller(tmp_path: Path) -> None:
    table_id, controller = table_in(tmp_path), controller_with(OLD, None)

    async def cut_off(table: ControllerTable) -> TableState:
        raise DeviceUncertain("robot", "uncertain which table is in force")

    controller.push_table = cut_off  # type: ignore[method-assign]
    with pytest.raises(DeviceUncertain):
        pushed(tmp_path, table_id, controller)
    assert [change["state"] for change in history_of(tmp_path)] == ["uncertain"]
    withdrawn(tmp_path, controller, replace(BEGUN, id=table_id))
    assert [change["state"] for change in history_of(tmp_path)] == ["not in force"]


def test_a_push_that_was_cut_off_after_its_activation_is_in_force_once_a_resumed_run_has_seen_it(
    tmp_path: Path,
) -> None:
    table_id, controller = table_in(tmp_path), controller_with(OLD, None)
    push_table = controller.push_table

    async def cut_off(table: ControllerTable) -> TableState:
        await push_table(table)
        raise DeviceUncertain("robot", "uncertain which table is in force")

    controller.push_table = cut_off  # type: ignore[method-assign]
    with pytest.raises(DeviceUncertain):
        pushed(tmp_path, table_id, controller)
    pushed(tmp_path, table_id, controller)
    assert [change["state"] for change in history_of(tmp_path)] == ["in force"]


def test_a_history_that_cannot_be_written_is_reported_and_the_table_is_pushed(tmp_path: Path) -> None:
    (tmp_path.parent / "tables").write_text("no folder")
    table_id, robot = table_in(tmp_path), Controller()
    context = run_of(tmp_path, robot)
    asyncio.run(push(context, PushInputs(table=table_id)))
    assert robot.table is not None
    assert robot.table.id == table_id
    assert any("the history of tables was not written" in text for text in context.said)


class Held(HostTableStore):
    """A robot whose controller keeps no table: this computer does."""

    name, serial = "robot", "SIM-1"

    def __init__(self, folder: Path) -> None:
        self.host_tables = HostTables("robot", folder / "host_tables.json", "SIM-1", "arm", 2.0)
        self.places: list[Any] = []

    async def move(self, target: Any, speed_percent: float) -> Any:
        self.places.append(target)
        return target


def test_a_table_that_this_computer_holds_is_pushed_driven_to_and_taken_back_by_the_same_steps(tmp_path: Path) -> None:
    robot: Any = Held(tmp_path)
    table_id = table_in(tmp_path)
    row = pushed(tmp_path, table_id, robot)
    assert (row.verified, row.active) == (True, True)
    asyncio.run(require_in_force(robot, table_id))
    asyncio.run(robot.move_to_row(2, 10.0))
    assert robot.places == [pytest.approx([angle + 1.1 for angle in HOME])]
    context = withdrawn(tmp_path, robot, row)
    assert context.recorded(TableStateRow)[-1].active is False
    assert asyncio.run(robot.table_state()) == TableState(None, None, None)
