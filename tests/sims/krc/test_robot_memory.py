"""A controller that is started again with the memory of the one before: the same robot, as it stood."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sims.memory import BadMemory, Memory
from tests.helpers.sims import HOME, STEP_DEG, cell_with_sphere, search_until_contact

THERE = (10.0, -80.0, 90.0, 0.0, 45.0, 20.0)


@pytest.fixture
def again(bench, tmp_path):
    """Starts a controller with the memory of the one before, which is gone."""

    def begin(**how):
        return bench(memory=Memory(tmp_path / "state.json"), **how)

    return begin


def test_the_robot_stands_where_it_arrived(again):
    again().ptp(THERE)
    assert again().command("HELLO")[2] == THERE


def test_a_robot_that_stood_in_contact_is_still_in_contact(bench, again):
    cell = cell_with_sphere(bench)
    errors = {"servo": 1, "repeatability": 1}
    pc = again(cell=cell, errors=errors)
    stood = search_until_contact(pc)[2]
    assert pc.loop.closed
    back = again(cell=cell, errors=errors)
    assert back.loop.closed
    assert back.command("HELLO")[2] == stood
    back.ptp(HOME)
    assert [closed for _, closed in back.changes] == [False]  # it was closed before anybody could watch


def test_the_count_of_a_poses_attempts_goes_on(bench, again):
    cell = cell_with_sphere(bench)
    pc = again(cell=cell, errors={"repeatability": 1})
    pc.ptp((-1.0, *HOME[1:]))
    pc.ptp(HOME)
    back = again(cell=cell, errors={"repeatability": 1})
    search_until_contact(back)
    back.ptp(HOME)
    back.changes.clear()
    search_until_contact(back)
    assert [line["attempt"] for line in back.truth_lines()] == [1, 2]
    world = back.world()
    for line in back.truth_lines():
        shift = np.subtract(line["tcp"], world.true_tcp(line["joints"]))
        assert shift == pytest.approx(world.scatter(HOME, line["attempt"]), abs=1e-9)


def test_a_standing_message_stands_until_it_is_acknowledged(again):
    again(faults=[{"fault": "robot.stop"}]).state(['Prog="ERROR"'])
    pc = again()
    pc.state(['Prog="ERROR"', 'Msg="KSS00001'])
    assert pc.ptp(THERE)[1] == 12
    assert pc.command("RESET")[1] == 0
    assert again().ptp(THERE)[1] == 0


def test_active_and_previous_table_stay_and_the_staged_one_does_not(again):
    pc = again()
    pc.push_row(HOME, "one")
    pc.push_row(THERE, "two")
    serial = pc.command("HELLO")[3].split('Serial="')[1].split('"')[0]
    assert pc.command("TSTAGE", 20, f'<Table Id="three" Serial="{serial}" Rows="1" Sum="00000000"/>')[1] == 0
    back = again()
    assert back.tables() == {"Active": "two", "Previous": "one"}
    assert back.command("PTPT", 50, '<Vel P="50.0"/><Row N="1"/>')[1:3] == (0, THERE)
    assert back.command("TROLLBACK")[1] == 0
    assert again().tables() == {"Active": "one", "Previous": "two"}


def test_a_robot_on_its_way_is_found_on_its_way(again, tmp_path):
    pc = again()
    pc.put('<Cmd Id="1" Op="PTP"><Vel P="0.1"/><Q A1="90" A2="-90" A3="90" A4="0" A5="45" A6="0"/></Cmd>')
    while 'A1="0.' in pc.state(['Prog="MOVING"']):
        pass
    told = json.loads((tmp_path / "state.json").read_text())["robot"]
    assert 0.0 < told["joints"][0] < 90.0
    assert told["commanded"] == pytest.approx(told["joints"], abs=6e-4)  # the program goes on from where it stands
    pc.command("HALT", 2)


def test_a_search_on_its_way_is_found_on_its_way(again, tmp_path):
    pc = again(errors={"servo": 1})
    pc.rsi_on()
    pc.cycles(400, lambda i: (STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))  # 1.6 s
    told = json.loads((tmp_path / "state.json").read_text())["robot"]
    assert 0.9 < told["joints"][0] < 1.6
    pc.finish((STEP_DEG * 399, 0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "part",
    [
        {"robot": {"joints": [0.0] * 6}},
        {"robot": {"joints": [0.0] * 5, "commanded": [0.0] * 6, "scatter": [0, 0, 0], "attempt": 0, "attempts": {}}},
        {"robot": {"joints": ["x"] * 6, "commanded": [0.0] * 6, "scatter": [0, 0, 0], "attempt": 0, "attempts": {}}},
        {"tables": {"active": {"id": "a", "sum": "00000000", "lines": "1;0\n"}}},
        {"tables": {"active": {"id": "a"}}},
        {"ageing": {"worn_mm": "much"}},
        {"robot": 7},
    ],
)
def test_a_damaged_memory_is_refused_not_guessed_at(bench, tmp_path, part):
    (tmp_path / "state.json").write_text(json.dumps({"cell": {}, **part}))
    with pytest.raises(BadMemory, match="damaged"):
        bench(memory=Memory(tmp_path / "state.json"))


def test_bad_memory_is_reported_before_anything_listens(tmp_path):
    (tmp_path / "state.json").write_text('{"cell": {"name": "other"}}')
    with pytest.raises(BadMemory, match="another cell: name other; this one is name mine"):
        Memory(tmp_path / "state.json", {"name": "mine"})
