"""The two lines to a controller, RSI process and EthernetKRL channel, and other devices' proof of life on the first."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import final

from cellctl.clock import Clock
from cellctl.devices import DeviceFault, DeviceLost, DeviceRefused, Guard, Identity, LimitExceeded
from drivers.kuka_rsi.cyclic.limits import OnlineLimits, SearchLimits
from drivers.kuka_rsi.cyclic.shared_block import GUARDS, SharedBlock, Slot
from drivers.kuka_rsi.cyclic.telegram import ReplyFormat
from drivers.kuka_rsi.eki.channel import EkiChannel, cure_of, refusal
from drivers.kuka_rsi.ethernet_config import read_ethernet_config
from drivers.kuka_rsi.robot.rsi_process import CyclicProcess, refusal_of_program
from drivers.kuka_rsi.settings import RsiSettings
from drivers.seen_through import see_through

ENGINE = "engine"
"""The engine's own beat, which guards every search."""

_OLDEST_ENGINE_BEAT_S = 0.25
"""Five beats of `_BEAT_S`. In that time a search at 10 mm/s goes on by 2.5 mm without an engine."""


@final
class GuardSlots:
    """The guards that beat, by slot; `block`: the shared block in use, replaced at a reconnection."""

    def __init__(self, device: str, block: Callable[[], SharedBlock | None]) -> None:
        self._device = device
        self._block = block
        self._slots = {ENGINE: 0}

    @property
    def names(self) -> tuple[str, ...]:
        """Names by slot."""
        return tuple(self._slots)

    def guard(self, name: str) -> Guard:
        """The slot of `name`, always the same one. Raises ValueError if all are taken."""
        slot = self._slots.setdefault(name, len(self._slots))
        if slot >= GUARDS:
            del self._slots[name]
            raise ValueError(f"{self._device}: no more than {GUARDS - 1} guards")
        return _SlotGuard(self._block, slot)

    def oldest_ns(self, guards: dict[str, float]) -> tuple[int, ...]:
        """Oldest beat allowed per slot, from names and seconds; 0 if a slot is unused.

        The engine's own guard can be made stricter, not weaker. Raises LimitExceeded for a guard of no time, which
        would guard nothing.
        """
        engine = min(guards.get(ENGINE, _OLDEST_ENGINE_BEAT_S), _OLDEST_ENGINE_BEAT_S)
        oldest = [0] * GUARDS
        for name, seconds in {**guards, ENGINE: engine}.items():
            if not seconds * 1e9 >= 1.0:  # nor NaN
                raise LimitExceeded(self._device, f"guard '{name}' of {seconds:g} s: more than 0 s are needed")
            self.guard(name)
            oldest[self._slots[name]] = round(seconds * 1e9)
        return tuple(oldest)


@final
class _SlotGuard:
    """Writes beats to a slot of the shared block in use."""

    def __init__(self, block: Callable[[], SharedBlock | None], slot: int) -> None:
        self._block = block
        self._place = Slot.BEATS + slot

    def beat(self, time_ns: int) -> None:
        """The device was alive at `time_ns` of the cell's clock."""
        if block := self._block():
            block.words[self._place] = time_ns


_BEAT_S = 0.05


@final
class ControllerLines:
    """Opened and closed together. `identity`: from the controller, None if not connected.

    `latency_s`: from the first command to its reply, in the cell's time.
    `sends_currents`, `sends_programmed`: the RSI Ethernet configuration has the motor currents, and the programmed
    joints, in its telegrams.
    """

    def __init__(
        self, device: str, settings: RsiSettings, clock: Clock, limits: SearchLimits, online: OnlineLimits
    ) -> None:
        self.identity: Identity | None = None
        self.latency_s = 0.0
        self.sends_currents = self.sends_programmed = False
        self._device = device
        self._settings = settings
        self._clock = clock
        self._limits = limits
        self._online = online
        self._eki: EkiChannel | None = None
        self._process: CyclicProcess | None = None
        self._beating: asyncio.Task[None] | None = None

    @property
    def connected(self) -> bool:
        """Whether there is an EthernetKRL channel, open or being opened."""
        return self._eki is not None

    @property
    def block(self) -> SharedBlock | None:
        """The memory shared with the RSI process; None without a process."""
        return self._process and self._process.block

    @property
    def process(self) -> CyclicProcess:
        """The RSI process. Raises DeviceLost if the robot is not connected."""
        if self._process is None:
            raise DeviceLost(self._device, "not connected")
        return self._process

    @property
    def eki(self) -> EkiChannel:
        """The EthernetKRL channel. Raises DeviceLost if the robot is not connected, or its RSI process has ended."""
        if lost := self._lost_process():
            raise lost
        return self.halting

    @property
    def halting(self) -> EkiChannel:
        """The EthernetKRL channel, also without the RSI process. Raises DeviceLost if the robot is not connected."""
        if self._eki is None:
            raise DeviceLost(self._device, "not connected")
        return self._eki

    async def open(self, engine: Guard, started: Callable[[], None]) -> Identity:
        """Start the process, open the channel, ask for the identity; `engine`: the guard for the engine's heartbeat.
        started: called as soon as there is a block.

        Raises DeviceRefused, DeviceUnreachable, DeviceFault; then all is closed again.
        """
        try:
            self._process = await self._start_process()
            started()
            self._eki = EkiChannel(self._device, self._settings.eki, self._clock)
            await self._eki.open()
            self._beating = asyncio.create_task(self._beat(engine), name=f"{self._device} heartbeat")
            self.identity = await self._ask_identity(self._eki)
        except BaseException:
            await see_through(self.close())
            raise
        return self.identity

    async def close(self) -> None:
        """End the process and close the channel, in any state."""
        if self._beating:
            self._beating.cancel()
            await asyncio.gather(self._beating, return_exceptions=True)
        eki, process = self._eki, self._process
        self.identity = self._beating = self._eki = self._process = None
        if eki:
            await eki.close()
        if process:
            with self._clock.standing():
                await process.end()

    def _lost_process(self) -> DeviceLost | None:
        return self._process and self._process.lost(self._device)

    async def _start_process(self) -> CyclicProcess:
        config = read_ethernet_config(self._settings)
        if config.errors:
            cure = "Correct the file, and load the same one on the controller."
            raise DeviceRefused(self._device, "; ".join(config.errors), cure)
        self.sends_currents = "DEF_MACur" in config.send
        self.sends_programmed = "DEF_ASPos" in config.send
        reply = ReplyFormat.of(config.sentype, config.receive, self._settings.correction, self._settings.stop)
        clock = self._clock
        with clock.standing():
            return await CyclicProcess.start(
                self._device, self._settings, clock.source, reply.template, self._limits, self._online
            )

    async def _ask_identity(self, eki: EkiChannel) -> Identity:
        asked_ns = self._clock.now_ns()
        reply = await eki.ask("HELLO")
        self.latency_s = (self._clock.now_ns() - asked_ns) * 1e-9
        if reply.code:
            raise refusal(self._device, reply, "HELLO")
        if error := refusal_of_program(self._device, reply.ident, self._settings):
            raise error
        stat = await eki.first_stat()
        if stat.program == "ERROR":
            what = f"the controller shows a message: {stat.message}"
            raise DeviceFault(self._device, what, cure_of(stat.message))
        serial = reply.ident.get("Serial", "")
        model, kss = reply.ident.get("Model", ""), reply.ident.get("KSS", "")
        return Identity(self._device, serial, model, f"KSS {kss}", serial.startswith("SIM-"))

    async def _beat(self, engine: Guard) -> None:
        """The engine's own proof of life: if its loop hangs, the beats stop and the RSI process holds the robot.

        If the RSI process ends, no command goes on: nobody else would notice it during a motion of the controller.
        """
        known = False
        while True:
            if self._eki and not known and (lost := self._lost_process()):
                known = True  # a halt that is sent next goes on
                self._eki.give_up(lost)
            engine.beat(self._clock.now_ns())
            await self._clock.sleep(_BEAT_S)
