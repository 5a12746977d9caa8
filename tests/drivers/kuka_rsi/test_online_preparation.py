"""Before RSI is on, the process prepares the model: whatever ends that, RSI stays off and no search is affected."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from cellctl.clock import WallClock
from cellctl.devices import CorrectionModel, DeviceLost, DeviceRefused, DeviceUncertain
from drivers.kuka_rsi.cyclic.limits import OnlineLimits
from drivers.kuka_rsi.cyclic.online_block import OnlineSlot, pack
from drivers.kuka_rsi.cyclic.online_correction import OnlineCorrection
from drivers.kuka_rsi.cyclic.session import SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import SharedBlock, Slot
from drivers.kuka_rsi.cyclic.telegram import CorrectionMode
from drivers.kuka_rsi.eki.channel import Reply
from drivers.kuka_rsi.robot.correcting import Correcting
from drivers.kuka_rsi.robot.holding import Holding
from tests.helpers.krc import wavy_model
from tests.helpers.runs import ROOT

MODEL = CorrectionModel("m1", {name: tuple(values) for name, values in wavy_model(1.0).items()})


class Preparing:
    """The engine's side, whose RSI process prepares the model for as long as the test lasts."""

    def __init__(self):
        self.block, fd = SharedBlock.create()
        os.close(fd)
        self.asked, self.alive, self.confirms = [], True, True
        process = SimpleNamespace(block=self.block, lost=self.lost)
        eki = SimpleNamespace(ask=self.ask, stat=SimpleNamespace(program="READY", message=""))
        lines = SimpleNamespace(
            process=process,
            block=self.block,
            connected=True,
            sends_programmed=True,
            eki=eki,
            halting=eki,
        )
        self.holding = Holding("robot", lines)
        self.correcting = Correcting("robot", WallClock(), lines, self.holding, OnlineLimits())

    def lost(self, device):
        return None if self.alive else DeviceLost(device, "the RSI process ended: killed")

    async def ask(self, operation, timeout_s=0.0):
        self.asked.append(operation)
        if not self.confirms:
            raise DeviceLost("robot", f"no answer to {operation}")
        return Reply(1, 0, "", None, {})

    async def correction_on(self):
        async with self.holding.held_in_trouble():
            order = SearchOrder(self.holding.search, (0.0,) * 6, (0.0,) * 6, 1.0, (0,) * 8)
            await self.correcting.begin(order, MODEL, CorrectionMode.ABSOLUTE)

    def the_next_search_is_none_of_the_correction(self):
        assert "CORRON" not in self.asked
        assert not self.holding.correcting
        assert self.block.words[Slot.ORDER] == 0
        return self.block.online.words[OnlineSlot.ORDER] != self.holding.search


@pytest.mark.parametrize(
    ("confirmed", "cause", "said"),
    [
        (True, DeviceLost("robot", "the line is gone"), DeviceLost),
        (False, DeviceLost("robot", "the line is gone"), DeviceUncertain),
        (True, asyncio.CancelledError(), asyncio.CancelledError),
        (False, asyncio.CancelledError(), asyncio.CancelledError),
    ],
)
def test_only_a_standstill_that_is_not_confirmed_makes_an_error_uncertain(confirmed, cause, said):
    async def go():
        robot = Preparing()
        robot.confirms = confirmed
        try:
            async with robot.holding.held_in_trouble():
                raise cause
        except BaseException as told:
            return told, robot.asked

    told, asked = asyncio.run(go())
    assert type(told) is said
    assert asked == ["HALT"]


async def under_way(robot):
    beginning = asyncio.create_task(robot.correction_on())
    await asyncio.sleep(0.05)
    assert not beginning.done()
    return beginning


def test_a_cancelled_preparation_leaves_no_correction_to_the_next_search():
    async def go():
        robot = Preparing()
        beginning = await under_way(robot)
        beginning.cancel()
        with pytest.raises(asyncio.CancelledError):
            await beginning
        assert robot.the_next_search_is_none_of_the_correction()

    asyncio.run(go())


def test_an_rsi_process_that_ends_while_it_prepares_leaves_rsi_off():
    async def go():
        robot = Preparing()
        beginning = await under_way(robot)
        robot.alive = False
        with pytest.raises(DeviceLost, match="the RSI process ended: killed"):
            await beginning
        assert robot.the_next_search_is_none_of_the_correction()

    asyncio.run(go())


def test_a_stop_during_the_preparation_leaves_rsi_off():
    async def go():
        robot = Preparing()
        beginning = await under_way(robot)
        await robot.holding.stop()
        with pytest.raises(DeviceRefused, match="a stop is set"):
            await asyncio.wait_for(beginning, 5)
        assert robot.the_next_search_is_none_of_the_correction()

    asyncio.run(go())


def test_the_step_is_compiled_also_where_no_folder_can_keep_it():
    """numba's locator of packages in an archive finds no place for ours, as in folders that cannot be written."""
    program = "import numpy; from drivers.kuka_rsi.cyclic.online_kernel import _cross; axes = numpy.eye(3)\n"
    program += "print(*_cross(axes[0], axes[1]))"
    environment = os.environ | {"NUMBA_CACHE_LOCATOR_CLASSES": "_ZipCacheLocator", "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("0.0 0.0 1.0\n", "")


def test_the_model_is_prepared_without_priority_and_answers_have_it_again(monkeypatch):
    """With it, a compiler at work for 10 s would keep another robot's process from a processor they share."""
    policy, at_work = [os.SCHED_FIFO], []
    monkeypatch.setattr(os, "sched_getscheduler", lambda pid: policy[-1])
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, new, parameter: policy.append(new))
    monkeypatch.setattr(OnlineCorrection, "_take_newest_model", lambda self: at_work.append(policy[-1]))
    block, fd = SharedBlock.create()
    os.close(fd)
    block.online.place_model(pack(MODEL.arrays))
    OnlineCorrection(SearchOrder(1, (0.0,) * 6, (0.0,) * 6, 1.0, (0,) * 8), OnlineLimits(), block.online)
    assert (at_work, policy[-1]) == ([os.SCHED_OTHER], os.SCHED_FIFO)
