"""A push whose connection is cut, at every byte of it: never half a table, and never a wrong word about which one."""

from __future__ import annotations

import pytest

from cellctl.devices import ControllerTable, DeviceLost, DeviceUncertain, TableRow, TableState
from tests.helpers.krc import ControllerTables, CutLine, Kept, channel_to


def table(rows: int) -> ControllerTable:
    pairs = [
        TableRow((0.5 * i, -90.0, 90.0, 0.0, 45.0, i / 7), (0.5 * i, -90.01, 90.02, 0, 45, i / 7)) for i in range(rows)
    ]
    return ControllerTable("0123456789abcdef", "SIM-000007", tuple(pairs))


def with_an_old_table() -> ControllerTables:
    return ControllerTables(active=Kept("old", 1, "00000000", [("1",) + ("0.000000",) * 12]))


async def push(line: CutLine, what: ControllerTable) -> TableState:
    async with channel_to(line) as channel:
        return await channel.push(what)


async def whole_push(what: ControllerTable) -> CutLine:
    line = CutLine(with_an_old_table())
    state = await push(line, what)
    assert state.active
    assert state.active.id == what.id
    return line


async def outcome_of(line: CutLine, what: ControllerTable) -> type[DeviceLost]:
    with pytest.raises(DeviceLost) as lost:
        await push(line, what)
    said = str(lost.value)
    assert ("uncertain" in said) == isinstance(lost.value, DeviceUncertain)
    assert ("was not activated" in said) == (not isinstance(lost.value, DeviceUncertain))
    return type(lost.value)


async def cut(direction: str, at: int, whole: CutLine, what: ControllerTable) -> type[DeviceLost]:
    """Cut a push, then judge what the driver said by what the controller has; at last push again, whole."""
    tables = with_an_old_table()
    line = CutLine(tables, **{direction: at})
    outcome = await outcome_of(line, what)
    assert tables.active
    if outcome is DeviceLost:
        assert "TACTIVATE" not in tables.operations
        assert tables.active.id == "old"
    before = whole.heard_before if direction == "hears" else whole.said_before
    if at < before["TACTIVATE"]:
        assert outcome is DeviceLost
    if at > before["TACTIVATE"]:
        assert outcome is DeviceUncertain
    assert tables.active.id == "old" or len(tables.active.lines) == len(what.rows)
    tables.operations.clear()
    again = await push(CutLine(tables), what)
    assert again.active
    assert (again.active.id, again.active.rows) == (what.id, len(what.rows))
    return outcome


@pytest.mark.long
@pytest.mark.parametrize("direction", ["hears", "says"])
def test_a_push_of_one_row_cut_at_any_byte_says_truly_which_table_is_in_force(direction, run):
    async def every_byte() -> None:
        what = table(1)
        whole = await whole_push(what)
        end = whole.heard if direction == "hears" else whole.said
        outcomes = [await cut(direction, at, whole, what) for at in range(end)]
        assert set(outcomes) == {DeviceLost, DeviceUncertain}

    run(every_byte())


@pytest.mark.long
@pytest.mark.parametrize("direction", ["hears", "says"])
def test_a_push_of_several_blocks_cut_anywhere_leaves_a_whole_table_in_force(direction, run):
    async def every_so_often() -> None:
        what = table(5)
        whole = await whole_push(what)
        end = whole.heard if direction == "hears" else whole.said
        outcomes = [await cut(direction, at, whole, what) for at in range(5, end, 5)]
        assert set(outcomes) == {DeviceLost, DeviceUncertain}

    run(every_so_often())
