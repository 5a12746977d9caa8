"""Compensation tables by variables: every row is read back, one variable activates, nothing in between counts."""

from __future__ import annotations

import asyncio

import pytest

from cellctl.devices import ControllerTable, DeviceFault, DeviceLost, DeviceRefused, LimitExceeded, TableRow

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)


def table(table_id, serial, count=3, turned=0.1):
    rows = tuple(
        TableRow((float(n), -90.0, 90.0, n / 1e6, 45.0, -0.25), (n + turned, -89.98, 90.01, 0.0, 44.9, 0.0))
        for n in range(count)
    )
    return ControllerTable(table_id, serial, rows)


def ids(state):
    return [info and info.id for info in (state.active, state.previous, state.staged)]


def test_tables_are_pushed_read_rolled_back_and_moved_to(on_wire):
    async def work(wire):
        robot, serial = wire.robot, wire.identity.serial
        assert await robot.read_table() is None
        with pytest.raises(DeviceRefused, match="no table to roll back"):
            await robot.rollback_table()
        first, second = table("a" * 64, serial), table("b" * 64, serial, 5, 0.2)
        assert ids(await robot.push_table(first)) == ["a" * 64, None, None]
        assert await robot.read_table() == first
        assert ids(await robot.push_table(second)) == ["b" * 64, "a" * 64, None]
        assert await robot.read_table() == second
        arrived = await robot.move_to_row(4, 20.0)
        assert max(abs(a - b) for a, b in zip(arrived, second.rows[3].compensated, strict=True)) < 0.01
        with pytest.raises(DeviceRefused, match="no row 6"):
            await robot.move_to_row(6, 20.0)
        assert ids(await robot.rollback_table()) == ["a" * 64, "b" * 64, None]
        assert await robot.read_table() == first
        assert ids(await robot.push_table(first)) == ["a" * 64, "b" * 64, None]

    on_wire(work)


def test_a_table_that_cannot_be_is_refused_before_a_row_is_written(on_wire):
    async def work(wire):
        serial = wire.identity.serial
        for wrong, error, said in (
            (table("a", "SIM-000000"), DeviceRefused, "made for controller SIM-000000"),
            (table("a", serial, 0), DeviceRefused, "0 rows"),
            (ControllerTable("a", serial, 501 * table("a", serial, 1).rows), DeviceRefused, "501 rows"),
            (table("a", serial, 2, 999.0), LimitExceeded, "A1 999.0000 deg is outside"),
        ):
            with pytest.raises(error, match=said):
                await wire.robot.push_table(wrong)
            assert ids(await wire.robot.table_state()) == [None, None, None]

    on_wire(work)


def test_a_row_that_is_stored_otherwise_is_found_and_the_old_table_stays(on_wire):
    async def work(wire):
        robot, serial = wire.robot, wire.identity.serial
        old = table("a" * 64, serial)
        await robot.push_table(old)
        await wire.fault("varproxy.alters", event="varproxy.row", count=3 + 1, for_ms=13)
        with pytest.raises(DeviceFault, match="row 2 read back differs"):
            await robot.push_table(table("b" * 64, serial))
        assert ids(await robot.table_state()) == ["a" * 64, None, "b" * 64]
        assert await robot.read_table() == old
        assert ids(await robot.push_table(table("b" * 64, serial))) == ["b" * 64, "a" * 64, None]

    on_wire(work)


def test_a_connection_lost_during_a_push_leaves_the_old_table_in_force(on_wire):
    async def work(wire):
        robot, serial = wire.robot, wire.identity.serial
        old = table("a" * 64, serial)
        await robot.push_table(old)
        await wire.fault("varproxy.cut", event="varproxy.row", count=3 + 2)
        with pytest.raises(DeviceLost, match="the old one is in force"):
            await robot.push_table(table("b" * 64, serial))
        await wire.second.connect()
        assert ids(await wire.second.table_state())[0] == "a" * 64
        assert await wire.second.read_table() == old
        await wire.second.close()

    on_wire(work)


def test_a_push_cut_in_its_first_bytes_says_that_the_old_table_is_in_force(on_wire):
    async def work(wire):
        robot, serial = wire.robot, wire.identity.serial
        await wire.fault("varproxy.cut")
        with pytest.raises(DeviceLost, match="was not activated, the old one is in force"):
            await robot.push_table(table("b" * 64, serial))

    on_wire(work)


def test_a_cancelled_push_leaves_the_old_table_in_force(on_wire):
    async def work(wire):
        robot, serial = wire.robot, wire.identity.serial
        await robot.push_table(table("a" * 64, serial))
        push = asyncio.create_task(robot.push_table(table("b" * 64, serial, 20)))
        await wire.clock.sleep(0.3)
        push.cancel()
        with pytest.raises(asyncio.CancelledError):
            await push
        assert ids(await robot.table_state())[0] == "a" * 64

    on_wire(work)
