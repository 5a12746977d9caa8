"""Motor currents of the controller: an RSI session at rest, beside the drives' own currents of the same motors."""

import asyncio
from math import sqrt

import pytest

from cellctl.devices import DeviceFault, DeviceRefused
from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.cyclic.search_cycle import SearchCycle
from drivers.kuka_rsi.cyclic.session import Cause, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import Sample, SharedBlock
from drivers.kuka_rsi.cyclic.telegram import Telegram
from drivers.kuka_rsi.robot.kuka_robot import mean_currents
from tests.helpers.simulated_robots import CELLS, DRIVES, ROBOT, cell_file, drive_cell

TILTED = (0.0, -60.0, 90.0, 20.0, 45.0, 0.0)
ZERO = (0.0,) * 6


@pytest.fixture
def in_cell(tmp_path):
    def run(story, robot=ROBOT, simulate=None):
        async def go():
            devices = {"robot": robot, "drives": DRIVES}
            async with drive_cell(cell_file(tmp_path, simulate, devices)) as cell:
                await cell.connect()
                return await story(cell)

        return asyncio.run(go())

    return run


@pytest.mark.parametrize("mode", ["absolute", "relative"])
def test_both_sources_agree_within_their_noise_and_nothing_moves(in_cell, tmp_path, mode):
    text = (CELLS / "rsi_ethernet.xml").read_text()
    (tmp_path / "rsi.xml").write_text(text.replace('HOLDON="1"', 'HOLDON="0"') if mode == "relative" else text)
    robot = f"{ROBOT.replace(str(CELLS / 'rsi_ethernet.xml'), str(tmp_path / 'rsi.xml'))}&mode={mode}"

    async def story(cell):
        await cell.robot.move(TILTED, 50.0)
        before = await cell.robot.joints()
        of_controller, of_drives = await cell.robot.currents(100), await cell.drives.currents(100)
        assert await cell.robot.joints() == before
        assert of_controller.samples == 100
        sigmas = [sqrt((a**2 + b**2) / 100) for a, b in zip(of_controller.sigma_a, of_drives.sigma_a, strict=True)]
        differences = [a - b for a, b in zip(of_controller.amperes, of_drives.amperes, strict=True)]
        assert all(abs(off) < 4 * sigma for off, sigma in zip(differences, sigmas, strict=True))
        assert max(map(abs, of_drives.amperes)) > 0.5

    in_cell(story, robot)


def test_the_brakes_are_open_in_such_a_session(in_cell):
    async def story(cell):
        await cell.robot.move(TILTED, 50.0)
        early = await cell.robot.currents(50)
        await cell.clock.sleep(5.0)
        late = await cell.robot.currents(50)
        assert late.amperes == pytest.approx(early.amperes, abs=0.02)

    in_cell(story, simulate={"drives": {"brakes_after_s": 2}})


def test_a_configuration_without_motor_currents_is_refused_with_its_cure(in_cell, tmp_path):
    text = (CELLS / "rsi_ethernet.xml").read_text()
    (tmp_path / "rsi.xml").write_text("\n".join(line for line in text.splitlines() if "MACur" not in line))

    async def story(cell):
        with pytest.raises(DeviceRefused, match="has no motor currents in its telegrams") as caught:
            await cell.robot.currents(10)
        assert "DEF_MACur" in caught.value.cure

    in_cell(story, ROBOT.replace(str(CELLS / "rsi_ethernet.xml"), str(tmp_path / "rsi.xml")))


def test_a_stop_that_is_set_refuses_the_currents_until_it_is_cleared(in_cell):
    async def story(cell):
        cell.robot.stop_now()
        with pytest.raises(DeviceRefused, match="a stop is set"):
            await cell.robot.currents(200)
        cell.robot.clear_stop()
        assert (await cell.robot.currents(20)).samples == 20
        with pytest.raises(ValueError, match="0 samples"):
            await cell.robot.currents(0)

    in_cell(story)


def test_every_answer_of_such_a_session_is_a_correction_of_zero():
    cycle = SearchCycle(SearchOrder(1, TILTED, ZERO, 1.0, (0,) * 8, hold_cycles=40), SearchLimits())
    answers = []
    for number in range(200):
        telegram = Telegram(str(4 * number), 4 * number, TILTED, 0)
        cycle.admit(telegram)
        answers.append(cycle.answer(telegram, 4_000_000 * number, False, (0,) * 8))
        if answers[-1][1]:
            break
    assert {correction for correction, _ in answers} == {ZERO}
    assert 40 <= len(answers) < 60
    assert cycle.cause is Cause.TRAVEL


def test_samples_carry_their_currents_through_the_shared_memory():
    block, _ = SharedBlock.create()
    with_currents = Sample(1, 4, 5, TILTED, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    block.add_sample(with_currents)
    block.add_sample(Sample(1, 8, 9, TILTED))
    assert block.samples(0)[0] == [with_currents, Sample(1, 8, 9, TILTED)]


def test_telegrams_without_readable_currents_are_a_fault_not_a_zero():
    samples = [Sample(1, 4, 5, TILTED, (0.1,) * 6), Sample(1, 8, 9, TILTED)]
    with pytest.raises(DeviceFault, match="without readable motor currents"):
        mean_currents("robot", samples)
