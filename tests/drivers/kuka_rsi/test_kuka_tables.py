"""Compensation tables as campaigns use them: pushed beside motion, never during it, and moved to row by row."""

from __future__ import annotations

import asyncio
import math

import pytest

from cellctl.devices import (
    CompensatedRobot,
    ControllerTable,
    DeviceRefused,
    DeviceUncertain,
    LimitExceeded,
    TableInfo,
    TableRow,
)
from tests.helpers.krc import ControllerTables

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
AWAY = (1.25, -90.0, 90.0, 0.0, 45.0, 0.0)


def row(number: int) -> TableRow:
    nominal = (number / 7, -90.0, 90.0, -0.0, 45.0, 179.999999)
    return TableRow(nominal, tuple(value + 0.0123456 for value in nominal))


def table(rows: int = 12, table_id: str = "9f86d081884c7d65", serial: str = "SIM-000007") -> ControllerTable:
    return ControllerTable(table_id, serial, tuple(row(number) for number in range(1, rows + 1)))


@pytest.fixture
def tables(controller):
    """Gives the fake controller tables; `late` holds back the answer to an operation by that many seconds."""
    kept = ControllerTables()
    kept.late = {}
    otherwise = controller._do

    def do(number: int, operation: str, document: bytes) -> None:
        if operation == "PTPT":
            go_to_row(number, document.decode())
        elif operation in ("TSTAGE", "TBLOCK", "TREAD", "TACTIVATE", "TROLLBACK", "TSTATE"):
            code, more = kept.answer(operation, document.decode())
            reply = lambda: controller._reply(number, code, "", more)  # noqa: E731
            controller._after(kept.late[operation], reply) if operation in kept.late else reply()
        else:
            otherwise(number, operation, document)

    def go_to_row(number: int, document: str) -> None:
        wanted = int(document.split('N="')[1].split('"')[0])
        if kept.active is None or not 0 < wanted <= len(kept.active.lines):
            controller._reply(number, 42)
            return
        joints = kept.active.lines[wanted - 1][7:]
        text = " ".join(f'A{i}="{value}"' for i, value in enumerate(joints, 1))
        otherwise(number, "PTP", f"<Q {text}/>".encode())

    controller._do = do
    return kept


@pytest.fixture
def with_robot(connected, run):
    """Runs `work(robot)` on a connected robot."""

    def do(work):
        async def on_the_line():
            async with connected() as robot:
                return await work(robot)

        return run(on_the_line())

    return do


def test_a_pushed_table_is_in_force_verified_and_can_be_read_again(tables, with_robot):
    async def work(robot):
        assert isinstance(robot, CompensatedRobot)
        return await robot.push_table(table()), await robot.read_table()

    state, back = with_robot(work)
    assert state.active == TableInfo("9f86d081884c7d65", 12, tables.active.sum)
    assert state.staged is None
    assert (back.id, back.serial) == ("9f86d081884c7d65", "SIM-000007")
    for sent, found in zip(table().rows, back.rows, strict=True):
        assert found.nominal == pytest.approx(sent.nominal, abs=5e-7)
        assert found.compensated == pytest.approx(sent.compensated, abs=5e-7)


@pytest.mark.parametrize("bad", [(math.nan, *HOME[1:]), HOME[:5]])
def test_a_row_that_is_no_joint_reading_is_not_sent(tables, with_robot, bad):
    with pytest.raises(LimitExceeded):
        with_robot(lambda robot: robot.push_table(ControllerTable("t", "SIM-000007", (TableRow(HOME, bad),))))
    assert tables.operations == []


def test_an_activation_answered_late_is_waited_for(tables, with_robot):
    tables.late["TACTIVATE"] = 5.0
    state = with_robot(lambda robot: robot.push_table(table()))
    assert state.active.id == table().id


def test_an_activation_that_is_never_answered_is_uncertain(tables, with_robot):
    tables.late["TACTIVATE"] = 3600.0
    with pytest.raises(DeviceUncertain, match="no answer to TACTIVATE"):
        with_robot(lambda robot: robot.push_table(table()))


def test_a_push_cancelled_at_its_activation_sees_it_through(tables, with_robot):
    tables.late["TACTIVATE"] = 1.0

    async def work(robot):
        pushing = asyncio.create_task(robot.push_table(table()))
        while "TACTIVATE" not in tables.operations:
            await asyncio.sleep(0)
        pushing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await pushing
        return list(tables.operations), await robot.table_state()

    operations, state = with_robot(work)
    assert operations[-2:] == ["TACTIVATE", "TSTATE"]
    assert state.active.id == table().id


def test_a_move_to_a_row_ends_at_its_compensated_joints(tables, with_robot):
    async def work(robot):
        await robot.push_table(ControllerTable("t", "SIM-000007", (TableRow(HOME, HOME), TableRow(HOME, AWAY))))
        return await robot.move_to_row(2, 10.0)

    assert with_robot(work) == AWAY


@pytest.mark.parametrize("wanted", [0, 13])
def test_a_row_that_the_active_table_lacks_is_refused_and_nothing_moves(tables, controller, with_robot, wanted):
    async def work(robot):
        await robot.push_table(table())
        with pytest.raises(DeviceRefused, match="no such table or row"):
            await robot.move_to_row(wanted, 10.0)

    with_robot(work)
    assert tuple(controller.joints) == HOME


@pytest.mark.parametrize("speed", [0.0, 100.1, math.nan])
def test_a_move_to_a_row_at_no_speed_is_not_sent(tables, controller, with_robot, speed):
    with pytest.raises(LimitExceeded):
        with_robot(lambda robot: robot.move_to_row(1, speed))
    assert "PTPT" not in controller.commands


def test_a_cancelled_move_to_a_row_halts_the_robot(tables, controller, with_robot):
    controller.move_takes_s = 60.0

    async def work(robot):
        await robot.push_table(ControllerTable("t", "SIM-000007", (TableRow(HOME, AWAY),)))
        moving = asyncio.create_task(robot.move_to_row(1, 10.0))
        while controller.program != "MOVING":
            await asyncio.sleep(0)
        moving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await moving

    with_robot(work)
    assert controller.halts_ended == 1
    assert tuple(controller.joints) == HOME


def test_no_table_is_touched_while_the_robot_moves(tables, controller, with_robot):
    controller.move_takes_s = 1.0

    async def work(robot):
        moving = asyncio.create_task(robot.move(AWAY, 10.0))
        while controller.program != "MOVING":
            await asyncio.sleep(0)
        for busy in (robot.push_table(table()), robot.rollback_table(), robot.read_table()):
            with pytest.raises(DeviceRefused, match="another command is under way"):
                await busy
        return await moving

    assert with_robot(work) == AWAY
    assert tables.operations == []
