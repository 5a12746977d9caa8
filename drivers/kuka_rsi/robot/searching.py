"""One search, from the engine's side: RSI on, monitoring, RSI off, and the result from the samples in the ring."""

from __future__ import annotations

import asyncio
import math
from contextlib import suppress
from dataclasses import dataclass
from typing import final

from cellctl.clock import Clock, MinimumDelayFit
from cellctl.devices import (
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    JointReadings,
    LimitExceeded,
    SearchEnd,
    SearchResult,
)
from drivers.kuka_rsi.cyclic.limits import Limit
from drivers.kuka_rsi.cyclic.session import Cause, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import Sample, SearchStatus, SharedBlock, Slot
from drivers.kuka_rsi.eki.channel import ANSWER_S, EkiChannel, Pending, Reply, refusal
from drivers.kuka_rsi.robot.rsi_process import REMEDY, CyclicProcess, in_words, restarted

_ALL_OF_IT_S = 86_400.0
"""Window of the clocks' fit: the whole search."""

_FIRST_TELEGRAM_S = 2.0
_SILENCE_S = 2.0
"""Both longer than a controller waits for answers (`LONGEST_TOLERANCE_MS`): its own message comes first, as code 31."""

_POLL_S = 0.1
"""Cell time between two readings of the ring."""

_LOOK_S = 0.05
"""Wall time between two checks of the cyclic process."""

_BESIDES_THE_LINE_S = 15.0
"""Cell time of a search besides its motion: learning, ramps, the hold until standstill (1 s), RSI off. Generous: it
only ends a search that nothing else ends; silence ends one after `_SILENCE_S`."""

_LONGEST_CYCLE_S = 0.012

_FOLLOWED_DEG = 0.1
"""If an axis rests further than this from the end of the line, the corrections had no full effect. The coarsest step of
a telegram (Precision 1); a standing servo has no lag."""


@final
@dataclass(frozen=True, slots=True)
class RsiSearchResult(SearchResult):
    """A search with `ipoc`, the controller's count at each sample."""

    ipoc: tuple[int, ...]


@final
class SearchRecord:
    """Collects one search's samples and counts from the shared block."""

    def __init__(self, block: SharedBlock, number: int) -> None:
        self.samples: list[Sample] = []
        self._block = block
        self._number = number
        self._tail = block.words[Slot.HEAD]
        self._before = self._counts()

    def collect(self) -> None:
        """Read the new samples; call it before the ring overwrites them."""
        new, self._tail = self._block.samples(self._tail)
        self.samples += [sample for sample in new if sample.search == self._number]

    def counts(self) -> dict[str, int]:
        """`late`, `lost` and `skipped` telegrams of this search; late: the larger of our count and the controller's."""
        rises = {slot: now - self._before[slot] for slot, now in self._counts().items()}
        late = max(rises[Slot.LATE], rises[Slot.LATE_REPORTED])
        return {"late": late, "lost": rises[Slot.LOST], "skipped": rises[Slot.SKIPPED]}

    def delays_ns(self, status: SearchStatus) -> list[int]:
        """How much later than the fastest ones the telegrams arrived; empty if the cycle was not learnt."""
        arrivals = [sample.arrival_ns for sample in self.samples]
        fastest = self._times(status) if status.ipoc_step else ()
        return [arrival - time for arrival, time in zip(arrivals, fastest, strict=False)]

    def result(self, end: SearchEnd, status: SearchStatus, resting: JointReadings) -> RsiSearchResult:
        """The record of the search, its samples' times through the count → cell clock fit."""
        return RsiSearchResult(
            end=end,
            times_ns=self._times(status),
            ipoc=tuple(sample.ipoc for sample in self.samples),
            joints=tuple(sample.joints for sample in self.samples),
            resting=resting,
            stop_cycles=status.stop_cycles,
            **self.counts(),
        )

    def _times(self, status: SearchStatus) -> tuple[int, ...]:
        if not status.ipoc_step:
            return tuple(sample.arrival_ns for sample in self.samples)
        fit = MinimumDelayFit(_ALL_OF_IT_S)
        stamps = [sample.ipoc * status.cycle_ns // status.ipoc_step for sample in self.samples]
        for stamp, sample in zip(stamps, self.samples, strict=True):
            fit.add(stamp, sample.arrival_ns)
        line = fit.fit()
        return tuple(map(line.to_cell_ns, stamps))

    def _counts(self) -> dict[Slot, int]:
        slots = (Slot.LATE, Slot.LATE_REPORTED, Slot.LOST, Slot.SKIPPED)
        return {slot: self._block.words[slot] for slot in slots}


def foreign_datagrams(process: CyclicProcess) -> str:
    """The number of datagrams from other addresses than the controller's, as text."""
    sender = process.block.foreign_sender()
    last = f" (the last one seen from {sender})" if sender else ""
    return f"{process.block.words[Slot.FOREIGN]} datagrams came from other hosts than {process.heard}{last}"


@final
@dataclass(frozen=True, slots=True)
class Search:
    """A search ordered from the cyclic process. `guards`: names by slot, for messages about them."""

    device: str
    clock: Clock
    eki: EkiChannel
    process: CyclicProcess
    order: SearchOrder
    guards: tuple[str, ...]
    configuration: str

    async def run(self) -> SearchResult:
        """RSI on, search, RSI off. Raises as `SearchingRobot.search` does; after an interruption the caller halts."""
        record, reply = await self._session()
        return self._result(record, reply)

    async def at_rest(self) -> SearchRecord:
        """RSI on without a correction for `hold_cycles` telegrams at least, RSI off. Raises as `run`, DeviceRefused."""
        record, reply = await self._session()
        if self._result(record, reply).end is SearchEnd.STOPPED:
            raise DeviceRefused(self.device, "a stop is set: RSI was left at once", "clear the stop, then try again")
        return record

    async def _session(self) -> tuple[SearchRecord, Reply]:
        record = SearchRecord(self.process.block, self.order.number)
        self.process.block.place_order(self.order)
        pending = await self.eki.send("RSI")
        await self._on(pending)
        self.process.block.announce_session(self.order.number)
        final_reply = await self._first_telegram(pending) or await self._until_off(pending, record)
        self.process.block.release()
        record.collect()
        if final_reply.code:
            raise self._stopped(final_reply, record)
        return record, final_reply

    async def _on(self, pending: Pending) -> None:
        try:
            reply = await pending.reply(ANSWER_S)
        except TimeoutError:
            raise DeviceLost(self.device, f"no answer to RSI for {ANSWER_S:g} s") from None
        if reply.code != 1:
            raise refusal(self.device, reply, "search")

    async def _first_telegram(self, pending: Pending) -> Reply | None:
        """Wait for it; returns the command's last reply if that arrives instead."""
        deadline = self.clock.now() + _FIRST_TELEGRAM_S
        while self.clock.now() < deadline:
            if reply := await self._last_reply(pending):
                return reply
            if self._status().telegrams:
                return None
        host, port = self.process.listening
        raise DeviceLost(
            self.device,
            f"RSI is on, and no telegram came within {_FIRST_TELEGRAM_S:g} s; {foreign_datagrams(self.process)}",
            f"Where the controller sends from another address than {self.process.heard}, write controller=IP into the "
            f"robot's address. It must send to this computer's address on the RSI network, port {port} (<IP_NUMBER> "
            f"and <PORT> in {self.configuration}); bound here: {host}:{port}. Let UDP through the firewall, and keep "
            "RSI on a subnet of its own, apart from the KLI's.",
        )

    async def _until_off(self, pending: Pending, record: SearchRecord) -> Reply:
        """Collect until the controller has left RSI. Raises DeviceLost if it does not, or the process has ended."""
        # twice, as the path starts from standstill again after each answer that was not taken
        line_s = math.hypot(*self.order.correction) / self.order.speed_deg_s
        hold_s = self.order.hold_cycles * _LONGEST_CYCLE_S
        deadline = self.clock.now() + 2 * line_s + hold_s + _BESIDES_THE_LINE_S
        heard, heard_at = 0, self.clock.now()
        while True:
            reply = await self._last_reply(pending)
            record.collect()
            if reply:
                return reply
            now = self.clock.now()
            if len(record.samples) > heard:
                heard, heard_at = len(record.samples), now
            if now > deadline or now - heard_at > _SILENCE_S:
                counts = ", ".join(f"{name} {count}" for name, count in record.counts().items())
                counts += f", stale {self.process.block.words[Slot.STALE]}"
                what = f"the search did not end (no telegram for {now - heard_at:.1f} s; {counts})"
                raise DeviceLost(self.device, what)

    async def _last_reply(self, pending: Pending) -> Reply | None:
        """The command's last reply, if it comes within `_POLL_S` of the cell's time.

        Losses are detected in wall time: while a telegram is not answered, a simulated cell's time may be stopped.
        """
        with suppress(TimeoutError):
            async with self.clock.timeout(_POLL_S):
                while True:
                    self._look_for_loss()
                    with suppress(TimeoutError):
                        async with asyncio.timeout(_LOOK_S):
                            return await pending.reply(_POLL_S)
        return None

    def _look_for_loss(self) -> None:
        if lost := self.process.lost(self.device):
            raise lost
        status = self._status()
        if status.cause in (Cause.LOST, Cause.RESTARTED):
            raise self._lost(status)

    def _status(self) -> SearchStatus:
        status = self.process.block.status()
        if status.number == self.order.number:
            return status
        return SearchStatus(self.order.number, status.phase, Cause.NONE, 0, 0, 0, 0, 0, 0)

    def _stopped(self, reply: Reply, record: SearchRecord) -> Exception:
        error = refusal(self.device, reply, "search")
        counts = ", ".join(f"{name} {count}" for name, count in record.counts().items())
        error.add_note(f"telegrams of this search: {len(record.samples)}, {counts}")
        return error

    def _result(self, record: SearchRecord, reply: Reply) -> SearchResult:
        status = self._status()
        resting = reply.joints or self.eki.latest_joints
        match status.cause:
            case Cause.STOPPED:
                return record.result(SearchEnd.STOPPED, status, resting)
            case Cause.TRAVEL:
                if short := self._short_of_the_end(resting):
                    raise self._not_followed(short)
                return record.result(SearchEnd.TRAVEL, status, resting)
            case Cause.BEHIND:
                raise self._not_followed("too far behind the set-point")
            case Cause.AHEAD:
                raise self._ran_ahead()
        raise self._trouble(status)

    def _short_of_the_end(self, resting: tuple[float, ...]) -> str:
        """The axes that rest away from the end of the line, as text; may be empty."""
        away = [rest - a - b for rest, a, b in zip(resting, self.order.start, self.order.correction, strict=True)]
        return ", ".join(f"A{i} {off:+.2f} deg off" for i, off in enumerate(away, 1) if abs(off) > _FOLLOWED_DEG)

    def _not_followed(self, how: str) -> DeviceFault:
        """AXISCORR clamps silently, and a wrongly wired context has no effect."""
        return DeviceFault(
            self.device,
            f"the axes did not follow the corrections ({how})",
            "AXISCORR clamps silently at its limits (5 deg where none are set); or the context is wired to other "
            f"channels; or SENTYPE on the controller is not the one in {self.configuration}; or its program has "
            "RSI_ON(#ABSOLUTE) and the address mode=relative; or answers were lost.",
        )

    def _ran_ahead(self) -> DeviceFault:
        """Offsets interpreted as increments: the controller would accelerate without limit."""
        return DeviceFault(
            self.device,
            "the axes ran ahead of the corrections; RSI was left at once",
            "The controller's program has RSI_ON(#RELATIVE) and the address mode=absolute: both must say the same; or "
            "something else moves the robot.",
        )

    def _lost(self, status: SearchStatus) -> DeviceLost:
        if status.cause is Cause.RESTARTED:
            return restarted(self.device, "the search is over, and nothing is answered any more")
        return DeviceLost(
            self.device,
            f"the controller's count has risen by {status.detail} since the last answer: the search is over, and the "
            f"robot held (a gap of {self.process.tolerance} cycles is tolerated)",
            "Look at the network and at what else runs on this computer. Where the ETHERNET object's Timeout is not "
            f"{self.process.tolerance}, write tolerance=CYCLES into the robot's address.",
        )

    def _trouble(self, status: SearchStatus) -> Exception:
        match status.cause:
            case Cause.GUARD:
                name = self.guards[status.detail]
                allowed_s = self.order.guards_ns[status.detail] * 1e-9
                what = f"no sign of life for {status.age_ns * 1e-9:.3f} s ({allowed_s:g} s allowed); the robot held"
                return DeviceLost(name, what, "Look at the device, its line, and what else runs on this computer.")
            case Cause.LIMIT:
                name = Limit(status.detail).name.lower()
                return LimitExceeded(
                    self.device, f"the next set-point would have passed the {name} limit; the robot held"
                )
            case Cause.START:
                return DeviceFault(self.device, "the pose at RSI_ON is not the one that the search was planned from")
            case Cause.LOST | Cause.RESTARTED:
                return self._lost(status)
            case Cause.CYCLE:
                what = f"telegrams come every {status.detail * 1e-6:g} ms, and the address has "
                return DeviceFault(
                    self.device, f"{what}{in_words(self.process.cycle)}; RSI was left before any motion", REMEDY
                )
        return DeviceFault(self.device, "the controller left RSI by itself before the search had ended")
