"""A push that is cut at any of its messages leaves a complete table in force, and the error says which it may be."""

from __future__ import annotations

import asyncio

import pytest

from cellctl.devices import ControllerTable, DeviceFault, DeviceLost, DeviceUncertain, TableRow
from drivers.kuka_varproxy import variables
from drivers.kuka_varproxy.line import Answer, Kind
from drivers.kuka_varproxy.tables import Roles, TableMemory
from drivers.kuka_varproxy.variables import Variables

SERIAL = "4711"


def table(table_id, count=3):
    return ControllerTable(table_id, SERIAL, tuple(TableRow((n / 7,) * 6, (n / 9,) * 6) for n in range(count)))


def rounded(found):
    rows = (TableRow(*(tuple(round(a, 6) for a in part) for part in (r.nominal, r.compensated))) for r in found.rows)
    return ControllerTable(found.id, found.serial, tuple(rows))


class CutLine:
    """Answers as a controller with these variables; the connection is lost at message `cut`, done before or not."""

    def __init__(self, values, cut=None, *, done=False):
        self.values, self.cut, self.done, self.asked = values, cut, done, 0

    async def ask(self, kind, payload):
        lost, self.asked = self.asked == self.cut, self.asked + 1
        if lost and not self.done:
            raise DeviceLost("robot", "cut")
        size = int.from_bytes(payload[:2], "big")
        name, value = payload[2 : 2 + size].decode(), payload[4 + size :].decode()
        if kind is Kind.WRITE:
            self.values[name] = value
        if lost:
            raise DeviceLost("robot", "cut")
        text = self.values[name].encode()
        return Answer(1, kind, len(text).to_bytes(2, "big") + text, 1, True)


def memory(values, cut=None, *, done=False):
    line = CutLine(values, cut, done=done)
    return TableMemory("robot", Variables("robot", line), SERIAL), line


def run(work):
    return asyncio.run(work)


@pytest.fixture
def values():
    """Of a controller with table `old` in force."""
    found = {"KV_ROLES": "0"}
    run(memory(found)[0].push(table("old")))
    return found


@pytest.mark.parametrize("done", [False, True])
def test_wherever_a_push_is_cut_a_complete_table_is_in_force(values, done):
    whole = dict(values)
    pushing, line = memory(whole)
    run(pushing.push(table("new", 5)))
    ends = set()
    for cut in range(line.asked):
        left = dict(values)
        with pytest.raises(DeviceLost) as caught:
            run(memory(left, cut, done=done)[0].push(table("new", 5)))
        found = run(memory(left)[0].read())
        assert found in (rounded(table("old")), rounded(table("new", 5)))
        if type(caught.value) is DeviceLost:
            assert "the old one is in force" in caught.value.what
            assert found.id == "old"
        ends.add(type(caught.value))
    assert ends == {DeviceLost, DeviceUncertain}


@pytest.mark.parametrize("done", [False, True])
def test_wherever_a_rollback_is_cut_either_table_is_in_force_and_is_complete(values, done):
    run(memory(values)[0].push(table("new", 5)))
    whole = dict(values)
    rolling, line = memory(whole)
    run(rolling.rollback())
    for cut in range(line.asked):
        left = dict(values)
        with pytest.raises(DeviceLost):
            run(memory(left, cut, done=done)[0].rollback())
        assert run(memory(left)[0].read()) in (rounded(table("old")), rounded(table("new", 5)))


@pytest.mark.parametrize("number", [-1, 4, 11, 110, 212, 1000])
def test_roles_that_make_no_sense_are_a_fault_and_nothing_is_written(values, number):
    values["KV_ROLES"] = str(number)
    before = dict(values)
    with pytest.raises(DeviceFault, match="KV_ROLES makes no sense"):
        run(memory(values)[0].push(table("new")))
    assert values == before


@pytest.mark.parametrize("number", [0, 100, 12, 120, 213, 321])
def test_roles_are_three_banks_and_the_free_one_is_neither_active_nor_previous(number):
    roles = Roles.of(number)
    assert roles.number == number
    assert roles.free in (1, 2, 3)
    assert roles.free not in (roles.active, roles.previous)


def test_an_active_table_whose_rows_were_changed_is_a_fault(values):
    place = Roles.of(int(values["KV_ROLES"])).active
    row = variables.fields(values[f"KV_TAB[{place},2]"])
    changed = {name: int(value) + (name == "C6") for name, value in row.items()}
    values[f"KV_TAB[{place},2]"] = variables.structure("KV_ROW_T", changed)
    with pytest.raises(DeviceFault, match="check sum"):
        run(memory(values)[0].read())
