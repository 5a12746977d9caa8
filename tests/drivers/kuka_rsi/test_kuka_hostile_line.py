"""What else may come on the RSI network, against a real cyclic process: garbled telegrams, a flood from elsewhere."""

from __future__ import annotations

import asyncio
import socket
import time
from pathlib import Path
from statistics import median

from cellctl.clock import WallClock
from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.cyclic.session import SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import Slot
from drivers.kuka_rsi.robot.rsi_process import CyclicProcess
from drivers.kuka_rsi.settings import RsiSettings
from tests.studies import fuzz_telegrams

HOME = (0.0,) * 6
TEMPLATE = '<Sen><AK A1="{0:.6f}"/><Stop>{6:d}</Stop><IPOC>{7}</IPOC></Sen>'
FLOOD = 300
ROUNDS = 60


def test_garbled_telegrams_neither_end_the_process_nor_keep_it_from_answering(run):
    counted = run(fuzz_telegrams.fuzz(3000))
    assert counted["malformed"] > 1000
    assert counted["stale"] > 0
    assert counted["beyond"] > 0


def udp(host):
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line.bind((host, 0))
    line.settimeout(60)
    return line


def telegram(ipoc):
    axes = " ".join(f'A{i}="0.0000"' for i in range(1, 7))
    return f"<Rob><AIPos {axes}/><IPOC>{ipoc}</IPOC></Rob>".encode()


def round_trip_s(controller, place, ipoc):
    began = time.perf_counter()
    controller.sendto(telegram(ipoc), place)
    assert b"<IPOC>%d<" % ipoc in controller.recv(65535)
    return time.perf_counter() - began


def test_a_flood_from_another_address_does_not_delay_the_answers(run):
    """Each second telegram comes right behind a flood; both kinds are timed side by side."""

    async def flood():
        settings = RsiSettings(("127.0.0.1", 0), Path("rsi.xml"), ("127.0.0.1", 1))
        process = await CyclicProcess.start("robot", settings, WallClock().source, TEMPLATE, SearchLimits())
        process.block.place_order(SearchOrder(1, HOME, HOME, 1.0, (0,) * 8))
        process.block.announce_session(1)
        alone, behind = [], []
        try:
            with udp("127.0.0.1") as controller, udp("127.0.0.2") as other:
                for number in range(2 * ROUNDS):
                    for _ in range(FLOOD if number % 2 else 0):
                        other.sendto(telegram(9000), process.listening)
                    (behind if number % 2 else alone).append(
                        await asyncio.to_thread(round_trip_s, controller, process.listening, 1000 + 4 * number)
                    )
            return alone, behind, process.block.words[Slot.FOREIGN]
        finally:
            await process.end()

    alone, behind, foreign = run(flood())
    assert foreign == FLOOD * ROUNDS
    assert median(behind) < 4 * median(alone)
