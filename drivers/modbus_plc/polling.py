"""The background poll: inputs ten times a second, registers five times, heartbeats both ways, reconnection."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

from cellctl.clock import Clock
from cellctl.devices import DeviceError, DeviceLost
from drivers.modbus_plc.io_map import INPUTS, PC_HEARTBEAT, REGISTERS, Readings, WordOrder, named_inputs, readings
from drivers.modbus_plc.line import ModbusLine

PERIOD_S = 0.1
_REGISTERS_EVERY, _BEAT_EVERY = 2, 4
"""Polls from one reading of the registers, or heartbeat of this computer, to the next."""
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.2, 5.0
"""Before the first attempt to connect again; it doubles with each that fails."""

CLAMP_TRAVEL_S = 1.0
"""Longest time that neither sensor of the clamp may be on."""


@final
@dataclass(frozen=True, slots=True)
class PollLimits:
    """When a poll counts as stale, seconds. `age_s`: of the poll. `heartbeat_s`: since the PLC's counter changed."""

    age_s: float = 0.5
    heartbeat_s: float = 1.0


@final
@dataclass(frozen=True, slots=True)
class Poll:
    """What one poll found; `time_ns`: the cell's time before its first request."""

    time_ns: int
    inputs: dict[str, bool]
    readings: Readings


@final
class Polling:
    """Polls from `start` to `close`, on connections that `make_line` makes."""

    def __init__(
        self, device: str, clock: Clock, make_line: Callable[[], ModbusLine], limits: PollLimits, words: WordOrder
    ) -> None:
        self.reconnections = self.restarts = 0
        self._device, self._clock, self._make_line = device, clock, make_line
        self._limits, self._words = limits, words
        self._line: ModbusLine | None = None
        self._poll: Poll | None = None
        self._readings: Readings | None = None
        self._beat = self._polls = 0
        self._counter_ns = self._between_ns = 0
        self._trouble: DeviceError | None = None
        self._task: asyncio.Task[None] | None = None

    async def start(self) -> ModbusLine:
        """Connect, poll once, and go on in the background. Raises DeviceError."""
        self._line = self._make_line()
        try:
            await self._line.open()
            await self._poll_once(self._line)
        except BaseException:
            await self._line.close()
            raise
        self._task = asyncio.create_task(self._go_on(), name=f"{self._device} poll")
        return self._line

    async def close(self) -> None:
        """End the poll, and the connection."""
        if self._task:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self._line:
            await self._line.close()

    @property
    def line(self) -> ModbusLine:
        """The connection. Raises DeviceLost while there is none."""
        if self._line is None:
            raise self._trouble or DeviceLost(self._device, "is not connected", "connect it first")
        return self._line

    def age_s(self) -> float:
        """Age of the last poll, s."""
        return (self._clock.now_ns() - self._poll.time_ns) * 1e-9 if self._poll else float("inf")

    def latest(self) -> Poll:
        """The last poll. Raises DeviceLost if it, or the PLC's heartbeat in it, is too old."""
        if self._poll is None or self.age_s() > self._limits.age_s:
            if isinstance(self._trouble, DeviceLost):
                raise self._trouble
            what = f"its last poll is {self.age_s():.1f} s old; at most {self._limits.age_s:g} s count as safe"
            raise DeviceLost(self._device, what, "check the network to the PLC")
        still_s = (self._poll.time_ns - self._counter_ns) * 1e-9
        if still_s > self._limits.heartbeat_s:
            what = f"its heartbeat counter has not changed for {still_s:.1f} s: its program does not run"
            raise DeviceLost(self._device, what, "set the PLC to RUN, and look at its diagnosis")
        return self._poll

    def clamp_between_s(self) -> float:
        """Time for which neither sensor of the clamp has been on, s."""
        return (self._poll.time_ns - self._between_ns) * 1e-9 if self._poll else 0.0

    async def _go_on(self) -> None:
        wait_s = _FIRST_WAIT_S
        while True:
            began_ns = self._clock.now_ns()
            try:
                again = self._line is None
                self._line = self._line or await self._opened()
                await self._poll_once(self._line)
                self.reconnections += again
                wait_s = _FIRST_WAIT_S
                left_s = PERIOD_S - (self._clock.now_ns() - began_ns) * 1e-9
                await self._clock.sleep(max(left_s, 0.0))
            except DeviceError as trouble:
                await self._hang_up(trouble)
                await self._clock.sleep(wait_s)
                wait_s = min(2.0 * wait_s, _LONGEST_WAIT_S)

    async def _opened(self) -> ModbusLine:
        self._polls = 0  # the PLC may have missed this computer's heartbeat
        line = self._make_line()
        await line.open()
        return line

    async def _hang_up(self, trouble: DeviceError) -> None:
        if not isinstance(trouble, DeviceLost):
            trouble = DeviceLost(self._device, trouble.what, trouble.cure)
        self._trouble = trouble
        line, self._line = self._line, None
        if line:
            await line.close()

    async def _poll_once(self, line: ModbusLine) -> None:
        time_ns, unit = self._clock.now_ns(), line.unit
        bits = await line.ask("poll inputs", lambda c: c.read_discrete_inputs(0, count=len(INPUTS), device_id=unit))
        if len(bits.bits) < len(INPUTS):
            raise self._other_number()
        if self._readings is None or self._polls % _REGISTERS_EVERY == 0:
            self._read(time_ns, await self._registers(line))
        if self._polls % _BEAT_EVERY == 0:
            await self._change_heartbeat(line)
        if self._polls == 0:  # the PLC may have held the first value already, from an earlier connection
            await self._change_heartbeat(line)
        self._polls += 1
        inputs = named_inputs(bits.bits)
        if self._poll is None or inputs["clamped"] or inputs["unclamped"]:
            self._between_ns = time_ns
        assert self._readings is not None
        self._poll = Poll(time_ns, inputs, self._readings)

    async def _change_heartbeat(self, line: ModbusLine) -> None:
        self._beat ^= 1
        beat, unit = self._beat, line.unit
        await line.ask("write the heartbeat", lambda c: c.write_register(PC_HEARTBEAT, beat, device_id=unit))

    async def _registers(self, line: ModbusLine) -> Readings:
        unit = line.unit
        words = await line.ask("poll registers", lambda c: c.read_input_registers(0, count=REGISTERS, device_id=unit))
        if len(words.registers) != REGISTERS:
            raise self._other_number()
        return readings(words.registers, self._words)

    def _read(self, time_ns: int, found: Readings) -> None:
        last, self._readings = self._readings, found
        if last is None or found.counter != last.counter:
            self._counter_ns = time_ns
        if last is not None and found.uptime_s < last.uptime_s:
            self.restarts += 1

    def _other_number(self) -> DeviceLost:
        what = "answers with another number of values than asked"
        return DeviceLost(self._device, what, "check its Modbus server")
