"""RSI_ON(#RELATIVE): each cycle's value is added, limits hold the sum, HOLDON decides what a missed answer adds."""

from __future__ import annotations

import re

import pytest

from sims.cell import read_cell
from sims.krc._controller import rsi_settings
from sims.krc._rsi_exchange import AxisCorrection

SHIPPED_CELL = "procedures/cells/sphere_cell.yaml"


def a1(angle):
    return (angle, 0.0, 0.0, 0.0, 0.0, 0.0)


def a1_of(telegram):
    return float(re.search(r'<AIPos A1="([^"]*)"', telegram)[1])


@pytest.fixture
def relative(bench, request, tmp_path):
    """A controller whose program says RSI_ON(#RELATIVE), with this HOLDON of its corrections."""

    def begin(holdon=0, cycle_ms=4, **settings):
        text = (request.config.rootpath / "procedures/cells/rsi_ethernet.xml").read_text()
        (tmp_path / "e.xml").write_text(re.sub(r'(TAG="AK.*)HOLDON="1"', rf'\1HOLDON="{holdon}"', text))
        pc = bench(rsi={"mode": "relative", "cycle_ms": cycle_ms}, ethernet=tmp_path / "e.xml", **settings)
        pc.rsi_on()
        return pc

    return begin


@pytest.mark.parametrize("cycle_ms", [4, 12])
def test_each_value_is_added_and_zero_holds(relative, cycle_ms):
    pc = relative(cycle_ms=cycle_ms)
    telegrams = pc.cycles(6, lambda i: a1(0.01 if i < 3 else 0.0))
    assert [a1_of(telegram) for telegram in telegrams] == pytest.approx([0.0, 0.0, 0.01, 0.02, 0.03, 0.03])
    assert pc.finish()[2][0] == pytest.approx(0.03)


@pytest.mark.parametrize(("holdon", "reached"), [(0, 0.02), (1, 0.05)])
def test_a_missed_answer_adds_nothing_with_holdon_0_and_the_last_increment_with_1(relative, holdon, reached):
    pc = relative(holdon)
    pc.cycles(2, a1(0.01))
    pc.cycles(3, a1(0.5), sentype="WRONG")
    assert pc.finish()[2][0] == pytest.approx(reached)


def test_the_sum_is_clamped_without_a_word_and_the_way_back_begins_at_the_limit(relative):
    pc = relative(correction=AxisCorrection(limit_deg=0.05, relative=True))
    pc.cycles(10, a1(0.01))
    back = pc.cycles(4, a1(-0.01))
    assert [a1_of(telegram) for telegram in back] == pytest.approx([0.05, 0.05, 0.04, 0.03])
    assert pc.finish()[1] == 0


def test_a_sum_over_the_ceiling_stops_rsi(relative):
    pc = relative(correction=AxisCorrection(limit_deg=90.0, monitor_deg=0.05, relative=True))
    _, code, _, text = pc.until_reply(a1(0.01))
    assert code == 31
    assert "KSS29000" in text


def test_the_sum_begins_at_zero_with_each_rsi_on(relative):
    pc = relative()
    pc.cycles(3, a1(0.01))
    assert pc.finish()[1] == 0
    pc.rsi_on(8)
    assert [a1_of(telegram) for telegram in pc.cycles(3)] == pytest.approx([0.03] * 3)
    assert pc.finish()[2][0] == pytest.approx(0.03)


def test_an_offset_that_a_pc_takes_for_absolute_runs_away_until_the_drives_or_a_limit_stop_it(relative):
    pc = relative()
    _, code, _, text = pc.until_reply(lambda cycle: a1(0.008 * cycle))
    assert code == 31
    assert "Command" in text


@pytest.mark.parametrize(
    ("address", "section", "rsi_on"),
    [("", "", ("ABSOLUTE", "IPO_FAST")), ("&mode=relative", "", ("RELATIVE", "IPO_FAST")),
     ("&mode=absolute&cycle=ipo", "", ("ABSOLUTE", "IPO")), ("&mode=relative&cycle=ipo", "", ("RELATIVE", "IPO")),
     ("&mode=relative&cycle=ipo", "  rsi: {mode: absolute, cycle_ms: 4}", ("ABSOLUTE", "IPO_FAST")),
     ("&cycle=ipo_fast", "  rsi: {mode: relative, cycle_ms: 12}", ("RELATIVE", "IPO"))],
)  # fmt: skip
def test_mode_and_cycle_are_as_the_address_says_unless_the_simulate_section_says_another(
    request, tmp_path, address, section, rsi_on
):
    shipped = request.config.rootpath / SHIPPED_CELL
    text = shipped.read_text().replace("../robots", str(shipped.parents[1] / "robots"))
    (tmp_path / "cell.yaml").write_text(text.replace("eki=172.31.1.147:54600", f"eki=h:1{address}") + section + "\n")
    cell = read_cell(tmp_path / "cell.yaml")
    assert rsi_settings(cell.simulate.settings["rsi"], cell.addresses["robot"]).rsi_on == rsi_on
