"""Relative corrections and the 12 ms cycle, against a controller that sums up as RSI_ON(#RELATIVE) does."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.devices import Address, DeviceFault, DeviceLost, SearchEnd
from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.cyclic.search_cycle import SearchCycle
from drivers.kuka_rsi.cyclic.session import Cause, SearchOrder
from drivers.kuka_rsi.cyclic.telegram import CorrectionMode, Telegram, WrittenCorrections
from drivers.kuka_rsi.description import check_address

TWO_DEG = (0.0, -88.0, 90.0, 0.0, 45.0, 0.0)
ZERO = (0.0,) * 6
EITHER = pytest.mark.parametrize("mode", ["absolute", "relative"])


def offsets_of(controller):
    """Where the controller's correction stood after each answer, as it takes them, degrees."""
    sent = [answer.correction for answer in controller.answers]
    if not controller.relative:
        return sent
    return list(itertools.accumulate(sent, lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True))))


@pytest.fixture
def search(controller, connected, run):
    """Searches 2 deg along A2 in the given mode; the controller is switched to the same, the address to its cycle."""

    def search(mode, end=TWO_DEG, speed=2.0, limits=None, before=lambda robot: None):
        controller.relative = mode == "relative"
        cycle = "&cycle=ipo" if controller.cycle_ns == 12_000_000 else ""

        async def work():
            async with connected(limits, mode, cycle) as robot:
                before(robot)
                return await robot.search(end, speed)

        return run(work())

    return search


def test_relative_corrections_are_increments_that_add_up_to_the_line(controller, search, home):
    end = tuple(a + b for a, b in zip(home, (1.0, -0.5, 0.25, 0, 0, 1.0 / 3), strict=True))
    result = search("relative", end, 1.7)
    assert result.end is SearchEnd.TRAVEL
    assert result.resting == pytest.approx(end, abs=0.002)
    assert max(abs(value) for answer in controller.answers for value in answer.correction) < 1.7 * 0.004
    assert offsets_of(controller)[-1] == pytest.approx((1.0, -0.5, 0.25, 0, 0, 1.0 / 3), abs=6e-7)


def test_relative_holds_by_zeros(controller, search):
    search("relative")
    last = [answer.correction for answer in controller.answers[-15:]]
    assert last == [ZERO] * 15
    assert b"-0.000000" not in controller.answers[-1].raw


def test_the_path_is_the_same_in_both_modes(controller, search):
    search("relative")
    relative = offsets_of(controller)
    controller.answers.clear()
    controller.joints[:] = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
    search("absolute")
    assert len(relative) == len(controller.answers)
    for a, b in zip(relative, offsets_of(controller), strict=True):
        assert a == pytest.approx(b, abs=1.1e-6)


@EITHER
@pytest.mark.parametrize("cycle_ms", [4, 12])
def test_the_limits_are_per_second_in_each_mode_and_cycle(controller, search, mode, cycle_ms):
    controller.cycle_ns, controller.ipoc_step = cycle_ms * 1_000_000, cycle_ms
    limits = {"speed_deg_s": 1.5, "acceleration_deg_s2": 15, "jerk_deg_s3": 300}
    result = search(mode, speed=1.5, limits=limits)
    assert result.end is SearchEnd.TRAVEL
    assert {b - a for a, b in itertools.pairwise(result.times_ns)} == {controller.cycle_ns}
    path = [offset[1] for offset in offsets_of(controller)]
    for order, bound in ((1, 1.5), (2, 15), (3, 300)):
        path = [b - a for a, b in itertools.pairwise(path)]
        assert max(map(abs, path)) <= bound * (cycle_ms / 1000) ** order + 2**order * 1e-6
        if order == 1:
            assert max(path) == pytest.approx(1.5 * cycle_ms / 1000, rel=1e-3)


def test_a_cycle_of_12_ms_is_learnt_from_the_arrivals_where_the_count_goes_up_by_one(controller, search):
    controller.cycle_ns, controller.ipoc_step = 12_000_000, 1
    result = search("relative")
    assert {b - a for a, b in itertools.pairwise(result.times_ns)} == {12_000_000}
    steps = [answer.correction[1] for answer in controller.answers]
    assert max(steps) == pytest.approx(2.0 * 0.012, rel=1e-3)


@EITHER
@pytest.mark.parametrize(("stated", "cycle_ms", "count"), [("ipo_fast", 12, 12), ("ipo", 4, 4), ("ipo_fast", 12, 1)])
def test_a_controller_with_another_cycle_than_the_address_gets_zeros_alone(
    controller, connected, run, home, mode, stated, cycle_ms, count
):
    controller.cycle_ns, controller.ipoc_step, controller.relative = cycle_ms * 1_000_000, count, mode == "relative"

    async def work():
        async with connected(mode=mode, more=f"&cycle={stated}") as robot:
            with pytest.raises(DeviceFault, match=f"telegrams come every {cycle_ms} ms") as fault:
                await robot.search(TWO_DEG, 2.0)
            return fault.value

    assert "`cellctl krl`" in run(work()).cure
    assert {answer.correction for answer in controller.answers} == {ZERO}
    assert tuple(controller.joints) == home
    assert not controller.in_rsi


@EITHER
@pytest.mark.parametrize("cycle_ms", [4, 12])
def test_the_set_point_stands_in_the_second_telegram_after_contact(controller, search, mode, cycle_ms):
    controller.cycle_ns, controller.ipoc_step = cycle_ms * 1_000_000, cycle_ms

    def touch_at_60(robot):
        controller.on_cycle = lambda cycle: robot.stop_now() if cycle == 60 else None

    result = search(mode, before=touch_at_60)
    steps = [math.dist(a, b) for a, b in itertools.pairwise(offsets_of(controller))]
    full = 2.0 * cycle_ms / 1000
    assert steps[58] == pytest.approx(full, abs=2e-5)
    assert steps[59] == pytest.approx(full / 2, abs=2e-5)
    assert max(steps[60:]) == pytest.approx(0, abs=1e-9)
    assert (result.end, result.stop_cycles) == (SearchEnd.STOPPED, 2)


@EITHER
def test_lost_telegrams_make_no_leap(controller, search, mode):
    controller.unsent = range(100, 105)
    result = search(mode)
    steps = [math.dist(a, b) for a, b in itertools.pairwise(offsets_of(controller))]
    assert result.lost == 5
    assert result.end is SearchEnd.TRAVEL
    assert max(steps) <= 0.008 + 1e-6


def test_two_relative_searches_in_a_row_each_start_a_sum_of_their_own(controller, connected, run, home):
    controller.relative = True

    async def there_and_back():
        async with connected(mode="relative") as robot:
            await robot.search(TWO_DEG, 2.0)
            return await robot.search(home, 2.0)

    assert run(there_and_back()).resting == pytest.approx(home, abs=0.002)
    assert max(abs(value) for answer in controller.answers for value in answer.correction) <= 0.008


def test_a_guard_that_grows_old_holds_a_relative_search(controller, connected, run):
    controller.relative = True

    async def work():
        async with connected(mode="relative") as robot:
            with pytest.raises(DeviceLost, match="probe: no sign of life"):
                await robot.search(TWO_DEG, 2.0, {"probe": 0.2})

    run(work())
    moving = [i for i, answer in enumerate(controller.answers) if any(answer.correction)]
    assert moving[-1] == pytest.approx(51, abs=2)


@pytest.mark.parametrize(("cycle", "cycle_ms"), [("ipo_fast", 4), ("ipo", 12)])
def test_a_controller_that_sums_up_offsets_is_left_before_it_has_run_away(
    controller, connected, run, home, cycle, cycle_ms
):
    """The address says absolute, the program RSI_ON(#RELATIVE): the robot would go on ever faster."""
    controller.cycle_ns, controller.ipoc_step = cycle_ms * 1_000_000, cycle_ms

    async def work():
        async with connected(more=f"&cycle={cycle}") as robot:
            controller.relative = True
            with pytest.raises(DeviceFault, match="ran ahead") as fault:
                await robot.search(TWO_DEG, 2.0)
            return fault.value

    assert "mode=absolute" in run(work()).cure
    assert not controller.in_rsi
    assert controller.joints[1] - home[1] < 0.6


def test_a_controller_that_sums_up_offsets_is_left_after_a_contact_too(controller, connected, run, home):
    """Holding would be going on into what was touched."""

    async def work():
        async with connected() as robot:
            controller.relative = True
            controller.on_cycle = lambda cycle: robot.stop_now() if cycle == 14 else None
            with pytest.raises(DeviceFault, match="ran ahead"):
                await robot.search(TWO_DEG, 2.0)

    run(work())
    assert controller.joints[1] - home[1] < 0.6


def test_a_controller_that_takes_increments_for_offsets_is_named(controller, connected, run, home):
    async def work():
        async with connected(mode="relative") as robot:
            with pytest.raises(DeviceFault, match="behind the set-point") as fault:
                await robot.search(TWO_DEG, 2.0)
            return fault.value

    assert "mode=relative" in run(work()).cure
    assert controller.joints[1] - home[1] < 0.01


@pytest.mark.parametrize(
    ("mode", "xml", "what"),
    [
        ("absolute", "ethernet_xml", None),
        ("relative", "relative_xml", None),
        ("absolute", "relative_xml", 'AK.A1 has no HOLDON="1": one late answer would send the robot back'),
        ("relative", "ethernet_xml", 'AK.A1 has no HOLDON="0": while answers are late, the robot would go on'),
    ],
)
def test_holdon_must_fit_the_mode(tmp_path, request, mode, xml, what):
    (tmp_path / "rsi.xml").write_text(request.getfixturevalue(xml))
    address = Address.parse(f"kuka+rsi://127.0.0.1:0?ethernet=rsi.xml&eki=127.0.0.1:54600&mode={mode}")
    found = check_address(address, tmp_path)
    assert len(found) == (6 if what else 0)
    assert not what or what in found[0]


def test_an_unknown_mode_is_named(tmp_path):
    address = Address.parse("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&mode=incremental")
    assert "mode=incremental is none of absolute, relative" in check_address(address, tmp_path)[0]


def relative_cycle(length=2.0, limits=None):
    """A relative search and a function that feeds it one telegram, with joints that follow at once."""
    order = SearchOrder(1, ZERO, (0.0, length, 0.0, 0.0, 0.0, 0.0), 2.0, (0,) * 8)
    search = SearchCycle(order, limits or SearchLimits(), CorrectionMode.RELATIVE)
    state = {"ipoc": 1000, "sum": 0.0}

    def cycle(ipoc=None, delay=None):
        state["ipoc"] = state["ipoc"] + 4 if ipoc is None else ipoc
        joints = (0.0, state["sum"], 0.0, 0.0, 0.0, 0.0)
        telegram = Telegram(str(state["ipoc"]), state["ipoc"], joints, delay)
        search.admit(telegram)
        correction, stop = search.answer(telegram, state["ipoc"] * 1_000_000, False, [0] * 8)
        state["sum"] += correction[1]
        return correction[1], stop, state["sum"]

    return search, cycle


def test_the_limit_holds_the_sum_of_relative_corrections():
    search, cycle = relative_cycle(4.0, SearchLimits(correction_deg=1.5))
    sums = [cycle()[2] for _ in range(600)]
    assert search.cause is Cause.LIMIT
    assert 1.49 < sums[-1] <= 1.5


def test_an_increment_that_was_not_taken_is_not_repeated():
    """The sum falls short of the line, never beyond: a Delay that lies costs no limit."""
    _, cycle = relative_cycle()
    for _ in range(100):
        cycle(delay=0)
    lost = cycle(delay=0)[0]
    assert lost == pytest.approx(0.008, abs=2e-6)
    assert cycle(delay=1)[0] == 0.0
    assert 0 < cycle(delay=1)[0] < 1e-4


@given(st.lists(st.floats(-0.05, 0.05), min_size=1, max_size=500))
def test_what_is_written_adds_up_to_the_offset_however_long_it_goes_on(steps):
    written, offset, total = WrittenCorrections(CorrectionMode.RELATIVE), 0.0, 0.0
    for step in steps:
        offset += step
        total += float(f"{written.leading_to((offset,) * 6)[0]:.6f}")
        assert total == pytest.approx(offset, abs=5.1e-7)
