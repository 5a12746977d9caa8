"""A controller's compensation tables: what is put into force is what was meant, letter for letter, or nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cellctl.devices import (
    ControllerTable,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    TableInfo,
    TableRow,
)
from drivers.kuka_rsi.eki.channel import LARGEST_DOCUMENT, write_command
from drivers.kuka_rsi.eki.tables import WrittenRow, block, blocks, checksum, written_rows
from tests.helpers.krc import ControllerTables, CutLine, Kept, channel_to


def row(number: int) -> TableRow:
    nominal = (number / 7, -90.0, 90.0, -0.0, 45.0, 179.999999)
    return TableRow(nominal, tuple(value + 0.0123456 for value in nominal))


def table(rows: int = 12, table_id: str = "9f86d081884c7d65", serial: str = "SIM-000007") -> ControllerTable:
    return ControllerTable(table_id, serial, tuple(row(number) for number in range(1, rows + 1)))


@pytest.fixture
def tables():
    return ControllerTables()


@pytest.fixture
def line(tables):
    return CutLine(tables)


@pytest.fixture
def with_tables(line, run):
    """Runs `work(channel)` on the controller's tables."""

    def do(work):
        async def on_the_line():
            async with channel_to(line) as channel:
                return await work(channel)

        return run(on_the_line())

    return do


def test_the_check_sum_is_the_one_of_the_reference():
    """By hand: printf '1;0.000000;…\\n' | gzip -c | tail -c8 | head -c4 | od -tx4."""
    rows = [WrittenRow.of(1, TableRow((0.0, -90.0, 90.0, 0.0, 45.0, 0.0), (0.01, -90.02, 90.03, 0.0, 45.0, -0.5)))]
    line = "1;0.000000;-90.000000;90.000000;0.000000;45.000000;0.000000;"
    assert rows[0].line == line + "0.010000;-90.020000;90.030000;0.000000;45.000000;-0.500000\n"
    assert checksum(rows) == "422DA4F7"


def test_a_zero_is_written_without_a_sign():
    rows = written_rows(ControllerTable("t", "s", (TableRow((-0.0, -4e-7, 0, 0, 0, 0), (-6e-7, 0, 0, 0, 0, 0)),)))
    assert rows[0].nominal[:2] == ("0.000000", "0.000000")
    assert rows[0].compensated[0] == "-0.000001"


def test_the_largest_block_fits_a_document_of_the_channel():
    wide = TableRow((-123.456789,) * 6, (-123.456789,) * 6)
    rows = written_rows(ControllerTable("f" * 64, "SIM-000007", (wide,) * 500))
    assert [number for numbers in blocks(499) for number in numbers] == list(range(1, 500))
    assert max(map(len, blocks(499))) <= 10
    assert len(write_command(999_999, "TBLOCK", block(range(491, 501), rows))) <= LARGEST_DOCUMENT


def test_every_row_is_read_back_before_the_one_activation(tables, with_tables):
    with_tables(lambda channel: channel.push(table(5)))
    assert tables.operations == ["TSTAGE", *["TBLOCK"] * 3, *["TREAD"] * 3, "TACTIVATE", "TSTATE"]
    assert tables.blocks == [2, 2, 1]


@pytest.mark.parametrize("old", ["45.012346", 'N="7"', 'A1="1.000000"'])
def test_what_comes_back_otherwise_is_not_put_into_force(tables, with_tables, old):
    tables.tampered = {old: old.replace("4", "5").replace("7", "8").replace("1.0", "1.1")}

    async def work(channel):
        with pytest.raises(DeviceFault, match="read back differs") as fault:
            await channel.push(table())
        return str(fault.value), await channel.state()

    said, state = with_tables(work)
    assert "the old one is in force" in said
    assert state.active is None
    assert "TACTIVATE" not in tables.operations


def test_a_row_that_does_not_come_back_is_missed(tables, with_tables):
    whole = tables._tread
    tables._tread = lambda document: (0, whole(document)[1].partition('<R N="12">')[0])
    with pytest.raises(DeviceFault, match="came back as nothing"):
        with_tables(lambda channel: channel.push(table()))
    assert tables.active is None


@pytest.mark.parametrize("operation", ["TREAD", "TACTIVATE"])
def test_a_controller_restarted_in_mid_push_keeps_its_old_table(tables, with_tables, operation):
    """What was staged is gone then; read back, the old rows differ."""
    tables.active = Kept("old", 1, "", [("1",) + ("0.000000",) * 12])
    tables.forgets_before = operation
    with pytest.raises((DeviceFault, DeviceRefused)):
        with_tables(lambda channel: channel.push(table()))
    assert tables.active.id == "old"


def test_a_table_made_for_another_controller_is_refused_and_nothing_is_staged(tables, with_tables):
    async def work(channel):
        with pytest.raises(DeviceRefused, match="another controller"):
            await channel.push(table(serial="KR-42"))
        return await channel.state()

    state = with_tables(work)
    assert state.staged is None
    assert tables.operations == ["TSTAGE", "TSTATE"]


@pytest.mark.parametrize("rows", [0, 501])
def test_a_table_of_no_or_too_many_rows_is_not_sent(tables, with_tables, rows):
    with pytest.raises(DeviceRefused, match=f"{rows} rows"):
        with_tables(lambda channel: channel.push(table(rows)))
    assert tables.operations == []


@pytest.mark.parametrize("operation", ["TACTIVATE", "TSTATE"])
def test_a_connection_lost_from_the_activation_on_is_uncertain(tables, line, with_tables, operation):
    line.deaf = operation
    with pytest.raises(DeviceUncertain, match="uncertain"):
        with_tables(lambda channel: channel.push(table()))


@pytest.mark.parametrize("operation", ["TSTAGE", "TBLOCK", "TREAD"])
def test_a_connection_lost_before_the_activation_leaves_the_old_table_and_says_so(tables, line, with_tables, operation):
    line.deaf = operation
    with pytest.raises(DeviceLost, match="the old one is in force") as lost:
        with_tables(lambda channel: channel.push(table()))
    assert not isinstance(lost.value, DeviceUncertain)
    assert tables.active is None


def test_an_activation_that_put_something_else_into_force_is_a_fault(tables, with_tables):
    activate = tables._tactivate

    def forgetful(document: str) -> tuple[int, str]:
        activate(document)
        tables.active = replace(tables.active, lines=tables.active.lines[:-1], rows=11)
        return 0, ""

    tables._tactivate = forgetful
    with pytest.raises(DeviceFault, match="was activated, and yet rows 11 instead of 12"):
        with_tables(lambda channel: channel.push(table()))


def test_rollback_puts_the_table_before_into_force_and_back(tables, with_tables):
    async def work(channel):
        await channel.push(table(3, "first"))
        await channel.push(table(4, "second"))
        return await channel.rollback(), await channel.rollback()

    back, forth = with_tables(work)
    assert (back.active.id, back.previous.id) == ("first", "second")
    assert (forth.active.id, forth.previous.id) == ("second", "first")


def test_rollback_from_the_first_table_leaves_none_in_force(tables, with_tables):
    async def work(channel):
        await channel.push(table(3))
        return await channel.rollback(), await channel.read()

    state, read = with_tables(work)
    assert (state.active, read) == (None, None)
    assert state.previous.id == table().id


def test_rollback_without_any_table_is_refused(tables, with_tables):
    with pytest.raises(DeviceRefused, match="no such table"):
        with_tables(lambda channel: channel.rollback())


def test_a_rollback_whose_answer_is_lost_is_uncertain_for_twice_would_undo_it(tables, line, with_tables):
    tables.active = Kept("old", 1, "", [("1",) + ("0.000000",) * 12])
    line.deaf = "TROLLBACK"
    with pytest.raises(DeviceUncertain, match="uncertain whether"):
        with_tables(lambda channel: channel.rollback())


def test_a_staged_table_is_not_read_as_the_active_one(tables, with_tables):
    tables.staged = Kept("abandoned-in-mid-push", 3, "", [("1",) + ("0.000000",) * 12])

    async def work(channel):
        with pytest.raises(DeviceRefused, match="abandoned-in"):
            await channel.read()
        return await channel.state()

    assert with_tables(work).staged == TableInfo("abandoned-in-mid-push", 1, "")


def test_an_active_table_that_was_changed_on_the_controller_is_found_out(tables, with_tables):
    async def work(channel):
        await channel.push(table())
        tables.tampered = {"45.012346": "45.112346"}
        with pytest.raises(DeviceFault, match="check sum"):
            await channel.read()

    with_tables(work)


@pytest.mark.parametrize("nonsense", ['<Active Id="x" Rows="many" Sum="0"/>', '<Active Id="x"/>'])
def test_a_state_that_makes_no_sense_is_a_fault_of_the_controller(tables, with_tables, nonsense):
    tables._tstate = lambda document: (0, nonsense)
    with pytest.raises(DeviceFault, match="TSTATE makes no sense"):
        with_tables(lambda channel: channel.state())
