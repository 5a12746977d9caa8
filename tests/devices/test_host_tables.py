"""A table that this computer holds: the proof steps push it, go to it and take it back, as one on a controller."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from cellctl.devices import (
    ControllerTable,
    DeviceFault,
    DeviceRefused,
    HostTables,
    HostTableStore,
    LimitExceeded,
    TableRobot,
    TableRow,
    TableStore,
)
from cellctl.operations.table import active_id
from cellctl.procedure.check import missing_abilities

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)


class Robot(HostTableStore):
    """Moves at once; its controller keeps no table."""

    name, axes = "robot", 6

    def __init__(self, tables):
        self.host_tables = tables
        self.places = []

    async def connect(self): ...
    async def health(self): ...
    async def stop(self): ...
    async def close(self): ...

    async def joints(self):
        return self.places[-1] if self.places else HOME

    async def move(self, target, speed_percent):
        self.places.append(target)
        return target


def table(name="first", by=0.1, serial="7", count=2):
    rows = [TableRow(tuple(a + n for a in HOME), tuple(a + n + by for a in HOME)) for n in range(count)]
    return ControllerTable(name, serial, tuple(rows))


@pytest.fixture
def tables(tmp_path):
    return HostTables("robot", tmp_path / "tables" / "host.json", "7", "arm A", 2.0)


def test_a_robot_without_tables_of_its_own_has_the_ability_that_the_proof_steps_ask_for(tables):
    assert not missing_abilities(Robot, TableStore)
    assert not missing_abilities(Robot, TableRobot)


def test_a_pushed_table_is_active_after_a_new_start_and_the_robot_goes_to_its_rows(tables):
    asyncio.run(Robot(tables).push_table(table()))
    robot = Robot(replace(tables))
    assert active_id(asyncio.run(robot.table_state())) == "first"
    assert asyncio.run(robot.read_table()) == table()
    assert asyncio.run(robot.move_to_row(2, 10.0)) == table().rows[1].compensated
    assert robot.places == [table().rows[1].compensated]


def test_a_rollback_activates_the_table_before_and_then_none(tables):
    tables.push(table("first"))
    tables.push(table("second"))
    assert active_id(tables.roll_back()) == "first"
    assert active_id(tables.roll_back()) is None
    with pytest.raises(DeviceRefused, match="no table to roll back"):
        tables.roll_back()


@pytest.mark.parametrize(("field", "value"), [("serial", "8"), ("calibration", "arm B")])
def test_a_table_for_another_arm_is_not_used_and_the_robot_does_not_move(tables, field, value):
    tables.push(table())
    robot = Robot(replace(tables, **{field: value}))
    for asked in (robot.table_state(), robot.read_table(), robot.move_to_row(1, 10.0), robot.rollback_table()):
        with pytest.raises(DeviceRefused, match=f"is for {field} '.*', the controller has '{value}'"):
            asyncio.run(asked)
    assert robot.places == []


def test_a_new_table_for_the_new_arm_replaces_the_old_one_for_good(tables):
    tables.push(table("old"))
    anew = replace(tables, calibration="arm B")
    assert active_id(anew.push(table("new"))) == "new"
    assert active_id(anew.roll_back()) is None


def test_what_does_not_fit_is_refused_and_the_table_before_stays(tables):
    tables.push(table())
    with pytest.raises(DeviceRefused, match="is for controller '8'"):
        tables.push(table("other", serial="8"))
    with pytest.raises(LimitExceeded, match=r"row 1 of table far corrects a joint by 2\.500°"):
        tables.push(table("far", by=2.5))
    with pytest.raises(LimitExceeded):
        tables.push(table("nan", by=float("nan")))
    with pytest.raises(DeviceRefused, match="0 rows"):
        tables.push(table("empty", count=0))
    assert active_id(tables.state()) == "first"


def test_a_lower_limit_than_at_the_push_holds_in_the_motion_too(tables):
    tables.push(table(by=1.0))
    robot = Robot(replace(tables, correction_deg=0.5))
    with pytest.raises(LimitExceeded):
        asyncio.run(robot.move_to_row(1, 10.0))
    assert robot.places == []


@pytest.mark.parametrize("row", [0, 3, -1])
def test_a_row_that_is_not_there_is_named(tables, row):
    tables.push(table())
    with pytest.raises(DeviceRefused, match=f"no row {row}: this computer holds rows 1 … 2"):
        tables.compensated(row)


@pytest.mark.parametrize("damage", [lambda text: text[:-40], lambda text: text.replace("45.1", "45.2"), lambda _: "[]"])
def test_a_damaged_file_is_named_and_a_push_replaces_it(tables, damage):
    tables.push(table())
    tables.file.write_text(damage(tables.file.read_text()))
    with pytest.raises(DeviceFault, match="cannot be read as a table"):
        tables.compensated(1)
    assert active_id(tables.push(table("anew"))) == "anew"


def test_a_full_disk_leaves_the_tables_as_they_were(tables, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    tables.push(table())
    monkeypatch.setattr("cellctl.devices.host_tables.write_atomically", full)
    with pytest.raises(DeviceRefused, match="No space left on device"):
        tables.push(table("second"))
    assert active_id(tables.state()) == "first"
