"""On-line correction from the engine's side: RSI on beside the controller's own motions, model, fade-out, RSI off."""

from __future__ import annotations

import asyncio
import time
from typing import final

from cellctl.clock import Clock
from cellctl.devices import (
    CorrectionModel,
    CorrectionReport,
    CorrectionSample,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
)
from drivers.kuka_rsi import AXES
from drivers.kuka_rsi.cyclic.limits import OnlineLimits
from drivers.kuka_rsi.cyclic.online_block import OnlineSlot, OnlineStatus, pack
from drivers.kuka_rsi.cyclic.session import Cause, Phase, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import Slot
from drivers.kuka_rsi.cyclic.telegram import CorrectionMode
from drivers.kuka_rsi.eki.channel import refusal
from drivers.kuka_rsi.robot.holding import Holding
from drivers.kuka_rsi.robot.lines import ControllerLines
from drivers.kuka_rsi.robot.rsi_process import REMEDY, in_words, restarted

_POLL_S = 0.02
"""Cell time between two looks at the process's phase."""

_BEGINS_S = 2.0
"""Cell time from "RSI on" to the first corrected cycle: 0.1 s to learn the cycle, the rest for a network's first
packets. The same is added to the time of a fade."""

_LOOK_S = 0.005
"""Wall time between two looks while the model is prepared: the cell's time stands."""

_PREPARED_S = 300.0
"""Wall time. A computer's first model is compiled: some 10 s, minutes beside much other work; later ones take 1 s."""

_ENDED = (
    "Connect again. If it ends once more, delete the compiler's files (online_kernel*.nbi, online_kernel*.nbc) in "
    "drivers/kuka_rsi/cyclic/__pycache__."
)

_SILENCE_S = 1.0
"""Twice the longest silence that a controller tolerates (`LONGEST_TOLERANCE_MS`): it has ended RSI by then."""

_SETTLED_S = 0.5
"""Samples older than this are complete, also while telegrams are under way."""

_COUNTS = (Slot.LATE, Slot.LATE_REPORTED, Slot.LOST)

_CAUSES = {
    Cause.GUARD: ("the engine gave no sign of life", "Look at what else runs on this computer."),
    Cause.UNKNOWN: (
        "a telegram had no programmed joints (ASPos) or no count of late answers (Delay)",
        "Load the RSI Ethernet configuration that the robot's address names on the controller.",
    ),
    Cause.NOT_TAKEN: (
        "for longer than the controller tolerates, no answer was known to be taken",
        "Look at the network and at what else runs on this computer.",
    ),
    Cause.MODEL: ("the model did not arrive complete", "Begin again; it is written anew."),
    Cause.LIMIT: ("the next correction would have passed a limit", "Report this: it is checked before."),
    Cause.BEHIND: (
        "the axes at rest were not where program and correction put them",
        "AXISCORR clamps silently at its limits; or the context is wired to other channels; or its program has "
        "RSI_ON(#RELATIVE).",
    ),
}


@final
class Correcting:
    """One on-line correction after the other; `holding` knows whether one is on, and its number.

    `model_id`: of the last model that was placed.
    """

    def __init__(
        self, device: str, clock: Clock, lines: ControllerLines, holding: Holding, limits: OnlineLimits
    ) -> None:
        self.model_id = ""
        self._device = device
        self._clock = clock
        self._lines = lines
        self._holding = holding
        self._limits = limits
        self._tail = 0
        self._before: tuple[OnlineStatus, tuple[int, ...]] | None = None
        self._unreported: DeviceFault | None = None  # a message ended it; the next `end` reports it

    async def begin(self, order: SearchOrder, model: CorrectionModel, mode: CorrectionMode) -> None:
        """RSI on, at rest. Raises DeviceRefused, DeviceFault, DeviceLost."""
        self._check_setup(mode)
        block, eki = self._lines.process.block, self._lines.eki
        self._place(model)
        self._before = block.online.status(), self._counts()
        _, self._tail = block.online.log(0, 1 << 62)
        block.online.words[OnlineSlot.ORDER] = order.number
        block.place_order(order)
        self._unreported = None
        self._holding.correcting = True
        await self._order_taken(order.number)
        if block.status().cause is Cause.OVER_LIMIT:
            self._released()
            most = self._limits.online_correction_deg
            what = f"the model's correction is over the limit of {most:g} deg in all of its measured region"
            cure = "Correct the nominal robot (joint zeros, tool, base), or raise online_correction_deg."
            raise DeviceRefused(self._device, what, cure)
        reply = await eki.ask("CORRON")
        if reply.code:
            self._released()
            raise refusal(self._device, reply, "on-line correction")
        block.announce_session(order.number)
        await self._until({Phase.MOVING}, _BEGINS_S)
        if trouble := self.trouble():
            raise trouble

    def replace(self, model: CorrectionModel) -> None:
        """Another model. Raises DeviceRefused."""
        self._check_on()
        self._place(model)

    def fade(self) -> None:
        """Let it fade to zero from now on, also while the robot moves."""
        self._lines.process.block.online.words[OnlineSlot.RAMP_OUT] = self._holding.search

    async def end(self) -> CorrectionReport:
        """Fade to zero, RSI off. Raises DeviceFault, DeviceLost."""
        if not self.is_on() and (fault := self._unreported):
            self._unreported = None
            raise fault
        self._check_on()
        self.fade()
        limits = self._limits
        # thrice the way at full rate, as each answer that was not taken costs a start from standstill
        ramp_s = 3 * limits.online_correction_deg / limits.online_rate_deg_s
        ramp_s += 2 * limits.online_rate_deg_s / limits.online_acceleration_deg_s2
        await self._until({Phase.LEAVING}, ramp_s + _BEGINS_S)
        trouble = self.trouble()
        reply = await self._lines.eki.ask("CORROFF")
        if reply.code:  # RSI is still on: it stays answered, and whoever stops the robot sends HALT
            raise refusal(self._device, reply, "end of the on-line correction")
        report = self._report()
        self._released()
        if trouble:
            raise trouble
        return report

    def samples(self) -> tuple[CorrectionSample, ...]:
        """Samples since the last call, up to half a second ago."""
        until_ns = self._clock.now_ns() - round(_SETTLED_S * 1e9)
        rows, self._tail = self._lines.process.block.online.log(self._tail, until_ns)
        return tuple(CorrectionSample(row.arrival_ns, row.programmed, row.correction, row.inside) for row in rows)

    def programmed(self) -> tuple[float, ...] | None:
        """The programmed joints of the last telegram, degrees; None without a correction."""
        block = self._lines.process.block
        corrects = self._holding.correcting and block.status().phase in (Phase.MOVING, Phase.BRAKING, Phase.LEAVING)
        return block.online.status().programmed if corrects else None

    def trouble(self) -> DeviceFault | DeviceLost | None:
        """Why the correction is no longer applied as ordered; None if it is, or none is on."""
        if not self._holding.correcting:
            return None
        if lost := self._lines.process.lost(self._device):
            return lost
        status = self._lines.process.block.status()
        if status.number != self._holding.search:
            return None
        if status.cause is Cause.LOST:
            what = f"RSI was lost during the on-line correction: the controller's count has risen by {status.detail}"
            return DeviceLost(self._device, what, "Look at the network and at what else runs on this computer.")
        if status.cause is Cause.RESTARTED:
            return restarted(self._device, "the on-line correction is over, and nothing is answered any more")
        if status.cause is Cause.CYCLE:
            what = f"telegrams come every {status.detail * 1e-6:g} ms, and the address has "
            what += f"{in_words(self._lines.process.cycle)}; nothing was corrected"
            return DeviceFault(self._device, what, REMEDY)
        if status.cause in _CAUSES:
            what, cure = _CAUSES[status.cause]
            return DeviceFault(self._device, f"{what}; the on-line correction was ramped out", cure)
        if status.telegrams and (silent_s := self._silent_s()) > _SILENCE_S:
            what = f"RSI is off: no telegram came for {silent_s:.1f} s; nothing is corrected any more"
            return DeviceLost(self._device, what, "Look at the controller's messages, then switch it on again.")
        return None

    async def _order_taken(self, number: int) -> None:
        """Wait for the process, which prepares the model first. It is this computer's work: the cell's time stands."""
        process, deadline = self._lines.process, time.monotonic() + _PREPARED_S
        try:
            with self._clock.standing():
                while process.block.status().number != number and not process.block.words[Slot.STOP]:
                    if lost := process.lost(self._device):
                        raise DeviceLost(self._device, lost.what, _ENDED)
                    if time.monotonic() > deadline:
                        what = f"the RSI process did not prepare the model within {_PREPARED_S:g} s; RSI is off"
                        raise DeviceLost(self._device, what, "Look at what else runs on this computer.")
                    await asyncio.sleep(_LOOK_S)
            if process.block.words[Slot.STOP]:
                raise DeviceRefused(self._device, "a stop is set: RSI stays off", "Clear the stop, then try again.")
        except BaseException:
            self._released()
            raise

    def _silent_s(self) -> float:
        """Since the newest telegram of the process."""
        block = self._lines.process.block
        newest, _ = block.samples(block.words[Slot.HEAD] - 1)  # one, or more where telegrams came in between
        return self._clock.now() - newest[-1].arrival_ns * 1e-9

    def _released(self) -> None:
        """RSI is off: nothing is answered any more."""
        self._lines.process.block.release()
        self._holding.leave_correction()

    def _check_on(self) -> None:
        if not self._holding.correcting:
            raise DeviceRefused(self._device, "no on-line correction is on")

    def is_on(self) -> bool:
        """Whether it is on: a message of the controller ends RSI, and with it the correction. Raises DeviceLost."""
        if self._holding.correcting and self._lines.eki.stat.program == "ERROR":
            self._unreported = self._stopped_by_controller()
            self._released()  # it stays off when the message is acknowledged
        return self._holding.correcting

    def _check_setup(self, mode: CorrectionMode) -> None:
        if self.is_on():
            trouble = self.trouble()
            what = "an on-line correction is on already" + (f", in trouble: {trouble.what}" if trouble else "")
            raise DeviceRefused(self._device, what, "End it first.")
        if mode is not CorrectionMode.ABSOLUTE:
            what = (
                "on-line correction needs RSI_ON(#ABSOLUTE): with increments, each lost answer would stay as an error"
            )
            raise DeviceRefused(self._device, what, "Write mode=absolute into the address, and load the files anew.")
        if not self._lines.sends_programmed:
            cure = 'add <ELEMENT TAG="DEF_ASPos" TYPE="DOUBLE" INDX="INTERNAL"/> to SEND, here and on the controller'
            raise DeviceRefused(self._device, "its telegrams have no programmed joints (DEF_ASPos)", cure)

    def _place(self, model: CorrectionModel) -> None:
        try:
            values = pack(model.arrays)
        except ValueError as error:
            cure = f"Make the model from a fit of this robot; it needs {AXES} joints."
            raise DeviceRefused(self._device, str(error), cure) from error
        self._lines.process.block.online.place_model(values)
        self.model_id = model.id

    async def _until(self, phases: set[Phase], limit_s: float) -> None:
        """Wait for a phase, or for trouble, which `trouble` then tells. Raises DeviceFault, DeviceLost."""
        deadline = self._clock.now() + limit_s
        while self._clock.now() < deadline:
            status = self._lines.process.block.status()
            if self.trouble() or (status.number == self._holding.search and status.phase in {*phases, Phase.OVER}):
                return
            if self._lines.eki.stat.program == "ERROR":
                self._released()
                raise self._stopped_by_controller()
            await self._clock.sleep(_POLL_S)
        raise DeviceLost(self._device, f"the on-line correction did not begin or end within {limit_s:.1f} s")

    def _stopped_by_controller(self) -> DeviceFault:
        what = f"the controller shows a message: {self._lines.eki.stat.message}; the on-line correction is off"
        return DeviceFault(self._device, what, "Look at the pendant, remove the cause, then acknowledge it.")

    def _counts(self) -> tuple[int, ...]:
        return tuple(self._lines.process.block.words[slot] for slot in _COUNTS)

    def _report(self) -> CorrectionReport:
        assert self._before
        then, counts = self._before
        now = self._lines.process.block.online.status()
        late, reported, lost = (b - a for a, b in zip(counts, self._counts(), strict=True))
        return CorrectionReport(
            cycles=now.cycles - then.cycles,
            limited=now.limited - then.limited,
            outside=now.outside - then.outside,
            late=max(late, reported),
            lost=lost,
            refused_models=int(now.refused > then.refused),
        )
