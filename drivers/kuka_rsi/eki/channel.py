"""The transfer channel, client side: documents, commands with their replies, state, silence; refusals with a cure."""

from __future__ import annotations

import asyncio
import itertools
import math
import re
from contextlib import suppress
from dataclasses import dataclass, field
from typing import final
from xml.etree import ElementTree

from cellctl.clock import Clock, Wire
from cellctl.devices import DeviceError, DeviceFault, DeviceLost, DeviceRefused, JointReadings, LimitExceeded
from drivers.kuka_rsi import AXIS_NAMES
from drivers.tcp_connection import connected, hang_up

LARGEST_DOCUMENT = 4096
"""Bytes, of the channel's protocol (docs/reference/eki-channel.md); a longer one is not of our program."""

_TOKEN = re.compile(
    rb"""<!--.*?-->|<\?.*?\?>|<!\[CDATA\[.*?\]\]>|<(?P<tag>/?[^\s<>!?/"'](?:[^<>"']|"[^"]*"|'[^']*')*)>""", re.DOTALL
)


@final
@dataclass(frozen=True, slots=True)
class Reply:
    """`<Rep>`: `code` as in the reference; `joints` actual, degrees, if sent; `ident` of HELLO.

    `document`: the complete reply, for elements that only some commands have.
    """

    id: int
    code: int
    text: str
    joints: JointReadings | None
    ident: dict[str, str]
    document: ElementTree.Element = field(default_factory=lambda: ElementTree.Element("Rep"), compare=False)


@final
@dataclass(frozen=True, slots=True)
class Stat:
    """`<Stat>`: operating mode, program state, standing message, actual joints in degrees."""

    mode: str
    program: str
    message: str
    joints: JointReadings


@final
class DocumentStream:
    """Splits a stream of XML documents at the end of each root element, for any TCP segmentation."""

    def __init__(self) -> None:
        self._buffer = b""
        self._scanned = 0
        self._depth = 0

    def feed(self, data: bytes) -> list[bytes]:
        """The documents that `data` completes. Raises ValueError if one exceeds 4 KiB."""
        self._buffer += data
        documents = []
        while end := self._end_of_document():
            self._refuse_longer(end)
            documents.append(self._buffer[:end].strip())
            self._buffer = self._buffer[end:].lstrip()
            self._scanned = self._depth = 0
        self._refuse_longer(len(self._buffer))
        return documents

    @staticmethod
    def _refuse_longer(size: int) -> None:
        if size > LARGEST_DOCUMENT:
            raise ValueError(f"a document of more than {LARGEST_DOCUMENT} bytes")

    def _end_of_document(self) -> int:
        while (at := self._buffer.find(b"<", self._scanned)) >= 0:
            token = _TOKEN.match(self._buffer, at)
            if token is None:
                self._scanned = at
                return 0
            self._scanned = token.end()
            if self._closes_root(token["tag"]):
                return token.end()
        return 0

    def _closes_root(self, tag: bytes | None) -> bool:
        if tag is None:
            return False
        if not tag.endswith(b"/"):
            self._depth += -1 if tag.startswith(b"/") else 1
        return self._depth <= 0


def read_document(document: bytes) -> Reply | Stat:
    """Read one document of the controller. Raises ValueError if it is neither `<Rep>` nor `<Stat>`."""
    try:
        root = ElementTree.fromstring(document)
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"not XML: {error}") from None
    joints = _joints(root.find("Q"))
    if root.tag == "Rep":
        ident = root.find("Ident")
        return Reply(
            _integer(root, "Id"),
            _integer(root, "Code"),
            root.get("Text", ""),
            joints,
            dict(ident.attrib if ident is not None else {}),
            root,
        )
    if root.tag == "Stat" and joints is not None:
        return Stat(root.get("Mode", ""), root.get("Prog", ""), root.get("Msg", ""), joints)
    raise ValueError(f"<{root.tag}> is no reply and no state")


def write_command(number: int, operation: str, content: str = "") -> bytes:
    """`<Cmd>` with the given content."""
    return f'<Cmd Id="{number}" Op="{operation}">{content}</Cmd>'.encode()


def point_to_point(target: JointReadings, speed_percent: float) -> str:
    """Content of `PTP`: speed in percent of each axis' maximum, target in degrees."""
    axes = " ".join(f'{name}="{value:.4f}"' for name, value in zip(AXIS_NAMES, target, strict=True))
    return f'<Vel P="{speed_percent:.4f}"/><Q {axes}/>'


def _joints(element: ElementTree.Element | None) -> JointReadings | None:
    if element is None or not element.attrib:
        return None
    values = tuple(float(element.get(name, "nan")) for name in AXIS_NAMES)
    if not all(map(math.isfinite, values)):
        raise ValueError("Q lacks an axis")
    return values


def _integer(element: ElementTree.Element, name: str) -> int:
    return int(element.get(name, ""))


_LEAP_CURE = (
    "A set-point was too far from the one before. Does something else on this network answer the controller's "
    "telegrams? Compare RSI_ON in its program (absolute or relative) with mode in the address. Then reset at the "
    "pendant."
)
_CURES = {
    "KSS01102": _LEAP_CURE,
    "Command acceleration": _LEAP_CURE,
    "KSS29002": "Answers came late, not at all, or with another SENTYPE than the controller's Ethernet configuration "
    "names: compare SENTYPE, tags and port in the file named in the address with the one on the controller, look at "
    "the late and lost counts and at what else runs on this computer. Then reset at the pendant.",
    "KSS29000": "The overall correction limit on the controller (6 mm / 6 deg where no AXISCORRMON sets another) is "
    "lower than the search: shorten it, or raise MaxA1 … MaxA6. Then reset at the pendant.",
}
_RESET = "Look at the message at the pendant, remove its cause, acknowledge it and select the program again."


def cure_of(message: str) -> str:
    """The cure for a message of the controller."""
    return next((cure for number, cure in _CURES.items() if number in message), _RESET)


def refusal(device: str, reply: Reply, doing: str) -> DeviceError:
    """The error for a reply with a code other than 0 and 1 (docs/reference/eki-channel.md); `doing`: the action asked
    for.

    A refusal (10, 12, 20, 21, 40 to 43) comes before anything moves; 30 and 31 end a motion, with the robot held.
    """
    text = f" ({reply.text})" if reply.text else ""
    match reply.code:
        case 10:
            return DeviceRefused(device, f"{doing}: the controller is busy with another command{text}")
        case 12:
            cure = (
                "Acknowledge the message, switch the drives on, choose EXT and start the program. In T1 it moves only "
                "with CC_ALLOW_T1=TRUE in cellctl.dat."
            )
            return DeviceRefused(device, f"{doing}: the controller is not ready{text}", cure)
        case 20:
            return LimitExceeded(device, f"{doing}: outside an axis limit{text}")
        case 21:
            return LimitExceeded(device, f"{doing}: speed outside 0.01 … 100 %{text}")
        case 30:
            return DeviceFault(device, f"{doing}: stopped by HALT; the robot is held{text}")
        case 31:
            return DeviceFault(device, f"{doing}: stopped by the controller: {reply.text}", cure_of(reply.text))
        case 40:
            cure = "A table holds for the one robot that it was identified on: push the one made for this controller."
            return DeviceRefused(device, f"{doing}: it was made for another controller{text}", cure)
        case 41:
            return DeviceRefused(device, f"{doing}: the check sum does not fit what arrived{text}", "Push again.")
        case 42:
            return DeviceRefused(device, f"{doing}: the controller has no such table or row{text}")
        case 43:
            return DeviceRefused(device, f"{doing}: the controller does not take that many rows{text}")
    return DeviceRefused(device, f"{doing}: not understood by the controller (code {reply.code}){text}")


ANSWER_S = 10.0
"""Longest wait, in the cell's time, for an immediate action of the controller; a block of a table takes longest, as its
check sum is computed in KRL (`tables.BLOCK_ROWS`)."""

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
            if message.code != 1:  # 1: RSI is on; the last reply follows
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
