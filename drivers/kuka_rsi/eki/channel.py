"""The transfer channel, client side: commands with their replies, the controller's state, and detection of silence."""

from __future__ import annotations

import asyncio
import itertools
from contextlib import suppress
from typing import final

from cellctl.clock import Clock, Wire
from cellctl.devices import DeviceError, DeviceLost, JointReadings
from drivers.kuka_rsi.eki.documents import DocumentStream, Reply, Stat, read_document, write_command
from drivers.tcp_connection import connected, hang_up

ANSWER_S = 10.0
"""Longest wait, in the cell's time, for an immediate action of the controller."""

SILENCE_S = 2.0
"""The controller reports its state every 100 ms; after this time without a document it is lost."""

_CHUNK = 4096


@final
class Pending:
    """A command in progress: its replies in order, or the error that ended the connection."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._replies: asyncio.Queue[Reply | DeviceError] = asyncio.Queue()

    async def reply(self, timeout_s: float) -> Reply:
        """The next reply. Raises TimeoutError after `timeout_s` of the cell's time, DeviceLost."""
        async with self._clock.timeout(timeout_s):
            reply = await self._replies.get()
        if isinstance(reply, DeviceError):
            self._replies.put_nowait(reply)
            raise reply
        return reply

    def put(self, reply: Reply | DeviceError) -> None:
        """A reply arrived, or the connection ended."""
        self._replies.put_nowait(reply)


@final
class EkiChannel:
    """One connection. `unreadable` counts documents other than reply and state."""

    def __init__(self, device: str, place: tuple[str, int], clock: Clock) -> None:
        self.unreadable = 0
        self._device = device
        self._place = place
        self._clock = clock
        self._numbers = itertools.count(1)
        self._pending: dict[int, Pending] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._writer: asyncio.StreamWriter | None = None
        self._wire: Wire | None = None
        self._lost: DeviceLost | None = None
        self._stat: Stat | None = None
        self._joints: JointReadings | None = None
        self._first_stat = asyncio.Event()
        self._heard_ns = 0

    async def open(self) -> None:
        """Connect. Raises DeviceUnreachable."""
        cure = "Is the controller on and its EthernetKRL program running? Is 'eki' in the address its KLI address?"
        reader, self._writer, self._wire = await connected(
            self._device, self._place, self._clock, peer="EthernetKRL connection", cure=cure
        )
        self._heard_ns = self._clock.now_ns()
        self._tasks = [asyncio.create_task(self._read(reader, self._wire)), asyncio.create_task(self._watch())]

    async def close(self) -> None:
        """Close the connection; commands in progress end with DeviceLost."""
        self._fail("the connection was closed")
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._writer:
            await hang_up(self._writer, self._clock)
            self._writer = None

    @property
    def stat(self) -> Stat:
        """The controller's state as last reported. Raises DeviceLost."""
        if self._lost or self._stat is None:
            raise self._lost or DeviceLost(self._device, "the controller has not reported its state yet")
        return self._stat

    @property
    def latest_joints(self) -> JointReadings:
        """The joints in the last document. Raises DeviceLost."""
        return self._joints or self.stat.joints

    async def first_stat(self) -> Stat:
        """Wait for the first report of state. Raises DeviceLost."""
        try:
            async with self._clock.timeout(ANSWER_S):
                await self._first_stat.wait()
        except TimeoutError:
            raise DeviceLost(self._device, "the controller does not report its state") from None
        return self.stat

    async def send(self, operation: str, content: str = "") -> Pending:
        """Send a command. Raises DeviceLost."""
        if self._lost or self._writer is None or self._wire is None:
            raise self._lost or DeviceLost(self._device, "not connected")
        pending, number = Pending(self._clock), next(self._numbers)
        self._pending[number] = pending
        command = write_command(number, operation, content)
        self._writer.write(command)
        self._wire.wrote(len(command))
        with suppress(OSError):  # the reader detects and reports it
            await self._writer.drain()
        return pending

    async def ask(self, operation: str, content: str = "", timeout_s: float = ANSWER_S) -> Reply:
        """Send a command and wait for its only reply. Raises DeviceLost, also without a reply."""
        return await self.answer_to(await self.send(operation, content), operation, timeout_s)

    async def answer_to(self, pending: Pending, operation: str, timeout_s: float = ANSWER_S) -> Reply:
        """The only reply to a command that was sent. Raises DeviceLost, also without a reply."""
        try:
            return await pending.reply(timeout_s)
        except TimeoutError:
            raise DeviceLost(self._device, f"no answer to {operation} for {timeout_s:g} s") from None

    async def _read(self, reader: asyncio.StreamReader, wire: Wire) -> None:
        stream = DocumentStream()
        try:
            while data := await reader.read(_CHUNK):
                self._heard_ns = self._clock.now_ns()
                for document in stream.feed(data):
                    self._take(document)
                wire.read(len(data))
            self._fail("the controller closed the EthernetKRL connection")
        except (OSError, ValueError) as error:
            self._fail(f"the EthernetKRL connection broke: {error}")

    def _take(self, document: bytes) -> None:
        try:
            message = read_document(document)
        except ValueError:
            self.unreadable += 1
            return
        self._joints = message.joints or self._joints
        if isinstance(message, Stat):
            self._stat = message
            self._first_stat.set()
        elif pending := self._pending.get(message.id):
            if message.code != 1:
                del self._pending[message.id]
            pending.put(message)

    async def _watch(self) -> None:
        while not self._lost:
            await self._clock.sleep(SILENCE_S / 4)
            silent_s = (self._clock.now_ns() - self._heard_ns) * 1e-9
            if silent_s > SILENCE_S:
                self._fail(f"nothing heard from the controller for {silent_s:.1f} s")

    def give_up(self, loss: DeviceLost) -> None:
        """End the commands in progress with `loss`; later ones, a halt first of all, are sent."""
        for pending in self._pending.values():
            pending.put(loss)
        self._pending.clear()

    def _fail(self, what: str) -> None:
        cure = (
            "The controller's program stops the robot when it loses the connection. Make sure that the robot stands, "
        )
        cure += "then look at the controller's network and program."
        self._lost = self._lost or DeviceLost(self._device, what, cure)
        self._first_stat.set()
        if self._wire:
            self._wire.close()
        self.give_up(self._lost)
