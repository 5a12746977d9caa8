"""Does anything on the RSI line end the cyclic process? Arguments: [N] [SEED].

Sends N (10^6 unless stated) garbled, malformed and hostile telegrams to a real cyclic process on loopback, all of them
from the session's own address. After each hundred another search is ordered and announced, and must be answered. Prints
what was sent and what the process counted.
"""

from __future__ import annotations

import asyncio
import random
import socket
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from cellctl.clock import WallClock
from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.cyclic.session import SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import Slot
from drivers.kuka_rsi.robot.rsi_process import CyclicProcess
from drivers.kuka_rsi.settings import RsiSettings

HOME = (0.0,) * 6
GOOD = b'<Rob><AIPos A1="%s" A2="0.0" A3="0.0" A4="0.0" A5="0.0" A6="0.0"/><Delay D="%s"/><IPOC>%s</IPOC></Rob>'
NUMBERS = [
    *(b"", b"0", b"-0", b"1", b"-1", b"99999999999999999999", b"1e300", b"-1e300", b"1e-300", b"nan", b"inf", b"1_0"),
    *(b"0x10", b" 5 ", b"9" * 5000, "٤٢".encode(), b"1e999", b"3600", b"-3601", b"1000000000000001", b"1000000000"),
]
HOSTILE = [
    b"",
    b"<Rob>" + b"<a>" * 9_000,
    b"<a>" * 9_000 + b"</a>" * 9_000,
    b'<!DOCTYPE Rob [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><Rob>&b;</Rob>',
    b'<?xml version="1.0" encoding="utf-16"?><Rob/>',
    b'<?xml version="1.0" encoding="nothing"?><Rob/>',
    b'<?xml version="1.0" encoding="cp037"?><Rob/>',
    b"\xef\xbb\xbf<Rob/>",
    b"<Rob " + b" ".join(b'a%d="1"' % i for i in range(5000)) + b"/>",
]
BURST = 50
"""Telegrams between two waits until the process has read them: fewer than its socket holds."""


class Line:
    """A controller's socket. `sent`: telegrams so far; `ipoc`: of the last good one; `search`: the last ordered."""

    def __init__(self, process: CyclicProcess) -> None:
        self.process = process
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(process.listening)
        self.socket.settimeout(5.0)
        self.sent = self.search = 0
        self.ipoc = 1000

    def send(self, telegrams: list[bytes]) -> None:
        """Send, and wait until all are read. Raises RuntimeError where the process has ended or does not go on."""
        words = self.process.block.words
        for telegram in telegrams:
            self.socket.send(telegram)
        self.sent += len(telegrams)
        deadline = time.monotonic() + 5.0
        while words[Slot.TELEGRAMS] + words[Slot.MALFORMED] < self.sent:
            if time.monotonic() > deadline or not self.process.alive():
                raise RuntimeError(f"after {self.sent} telegrams: {self.process.lost('robot')}")

    def garbled(self, chance: random.Random) -> bytes:
        kind = chance.random()
        if kind < 0.02:
            return chance.choice(HOSTILE)
        if kind < 0.05:
            return chance.randbytes(chance.randrange(200))
        fields = [b"0.0", b"0", b"%d" % (self.ipoc + chance.randrange(-50, 400))]
        if kind < 0.6:
            fields[chance.randrange(3)] = chance.choice(NUMBERS)
        telegram = bytearray(GOOD % tuple(fields))
        for _ in range(chance.randrange(4) if kind > 0.4 else 0):
            telegram[chance.randrange(len(telegram))] = chance.randrange(256)
        return bytes(telegram[: chance.randrange(len(telegram))] if kind > 0.95 else telegram)

    def answered(self) -> bool:
        """Whether a good telegram of a session just announced is answered with its own count and zero."""
        block = self.process.block
        self.search += 1
        self.ipoc += 1_000_000
        block.place_order(SearchOrder(self.search, HOME, (1.0, 0, 0, 0, 0, 0), 2.0, (0,) * 8))
        block.announce_session(self.search)
        self.send([GOOD % (b"0.0", b"0", b"%d" % self.ipoc)])
        while (reply := self.socket.recv(65535)).find(b"<IPOC>%d<" % self.ipoc) < 0:
            pass
        return b'A1="0.000000"' in reply


async def fuzz(number: int, seed: int = 1) -> Counter[str]:
    """Send `number` telegrams or a few more; what the process counted. Raises RuntimeError, TimeoutError."""
    template = '<Sen><AK A1="{0:.6f}" A2="{1:.6f}"/><Stop>{6:d}</Stop><IPOC>{7}</IPOC></Sen>'
    settings = RsiSettings(("127.0.0.1", 0), Path("rsi.xml"), ("127.0.0.1", 1))
    process = await CyclicProcess.start("robot", settings, WallClock().source, template, SearchLimits())
    chance, line = random.Random(seed), Line(process)
    try:
        while True:
            if not line.answered():
                raise RuntimeError(f"after {line.sent} telegrams a new session is not answered with zero")
            if line.sent >= number:
                break
            for _ in range(2):
                line.send([line.garbled(chance) for _ in range(BURST)])
        words = process.block.words
        counted = (Slot.TELEGRAMS, Slot.MALFORMED, Slot.STALE, Slot.BEYOND, Slot.SKIPPED, Slot.FOREIGN)
        return Counter(
            {"sent": line.sent, "answered": line.search} | {slot.name.lower(): words[slot] for slot in counted}
        )
    finally:
        line.socket.close()
        await process.end()


def main(words: Sequence[str]) -> None:
    """Send them, print what was counted."""
    print(dict(asyncio.run(fuzz(*map(int, words or ["1000000"])))))
