"""What the cyclic process does with its socket and its slots, in the test's own process and time."""

from __future__ import annotations

import os
import re
import socket

import pytest

from cellctl.devices import SearchEnd
from drivers.kuka_rsi.limits import SearchLimits
from drivers.kuka_rsi.responder import Responder
from drivers.kuka_rsi.search_cycle import SearchOrder
from drivers.kuka_rsi.search_record import SearchRecord
from drivers.kuka_rsi.shared_block import ROWS, Sample, SharedBlock, Slot
from drivers.kuka_rsi.telegram import ReplyFormat

HOME = (0.0,) * 6
TEMPLATE = (
    '<Sen><AK A1="{0:.6f}" A2="{1:.6f}" A3="{2:.6f}" A4="{3:.6f}" A5="{4:.6f}" A6="{5:.6f}"/>'
    "<Stop>{6:d}</Stop><IPOC>{7}</IPOC></Sen>"
)


class Bench:
    """A responder on a loopback socket, a controller's socket beside it, and a clock set by hand."""

    def __init__(self) -> None:
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line.bind(("127.0.0.1", 0))
        self.line.setblocking(False)
        self.controller = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.controller.settimeout(60)
        self.block, fd = SharedBlock.create()
        os.close(fd)
        self.now_ns = 0
        self.reading_takes_ns = 0
        self.ipoc = 1000
        self.responder = Responder(self.line, self.block, ReplyFormat(TEMPLATE), SearchLimits(), self.clock)

    def clock(self) -> int:
        self.now_ns += self.reading_takes_ns
        return self.now_ns

    def order(self, number: int = 1) -> None:
        self.block.place_order(SearchOrder(number, HOME, (1.0, 0, 0, 0, 0, 0), 2.0, (0,) * 8))

    def send(self) -> None:
        self.ipoc += 4
        self.now_ns += 4_000_000
        axes = " ".join(f'A{i}="0"' for i in range(1, 7))
        telegram = f'<Rob Type="KUKA"><AIPos {axes}/><IPOC>{self.ipoc}</IPOC></Rob>'
        self.controller.sendto(telegram.encode(), self.line.getsockname())

    def receive(self) -> tuple[int, float, bool]:
        """Count, correction of A1 and stop of the next reply."""
        reply = self.controller.recv(65535)
        values = re.search(rb'A1="([^"]*)".*<Stop>(\d)</Stop><IPOC>(\d+)<', reply)
        return int(values[3]), float(values[1]), values[2] == b"1"

    def cycle(self) -> tuple[int, float, bool]:
        self.send()
        self.responder.answer()
        return self.receive()


@pytest.fixture
def bench():
    bench = Bench()
    yield bench
    bench.line.close()
    bench.controller.close()


def test_of_several_waiting_telegrams_only_the_newest_is_answered(bench):
    bench.order()
    for _ in range(20):
        bench.cycle()
    for _ in range(4):
        bench.send()
    bench.responder.answer()
    assert bench.receive()[0] == bench.ipoc
    bench.controller.setblocking(False)
    with pytest.raises(BlockingIOError):
        bench.controller.recv(65535)
    assert bench.block.words[Slot.SKIPPED] == 3
    assert bench.block.words[Slot.LOST] == 0
    assert len(bench.block.samples(0)[0]) == 24


def test_the_reply_goes_to_whoever_sent_the_telegram(bench):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.settimeout(60)
        bench.cycle()
        bench.controller, controller = other, bench.controller
        bench.cycle()
        bench.controller = controller


def test_without_an_order_every_telegram_is_answered_with_zero(bench):
    assert bench.cycle() == (1004, 0.0, False)
    assert bench.block.words[Slot.HEAD] == 0


def test_a_stop_set_after_the_telegram_left_but_before_it_is_read_counts_for_its_reply(bench):
    bench.order()
    for _ in range(100):
        bench.cycle()
    _, before, _ = bench.cycle()
    bench.send()
    bench.block.words[Slot.STOP] = 1
    bench.responder.answer()
    _, braked, _ = bench.receive()
    _, stood, _ = bench.cycle()
    assert braked - before == pytest.approx(0.004, abs=2e-6)
    assert stood == braked
    assert bench.block.status().stop_cycles == 2


def test_a_stop_meant_for_an_earlier_search_does_not_stop_this_one(bench):
    bench.block.words[Slot.STOP] = 1
    bench.order(2)
    for _ in range(30):
        bench.cycle()
    assert bench.cycle()[1] > 0


def test_after_the_release_the_next_session_gets_zero(bench):
    bench.order()
    for _ in range(300):
        bench.cycle()
    assert bench.cycle()[1] > 0
    bench.block.release()
    assert bench.cycle() == (bench.ipoc, 0.0, False)


def test_an_answer_that_took_longer_than_the_cycle_is_late(bench):
    bench.order()
    for _ in range(20):
        bench.cycle()
    assert bench.block.words[Slot.LATE] == 0
    bench.reading_takes_ns = 2_100_000
    bench.cycle()
    assert bench.block.words[Slot.LATE] == 1


def test_samples_of_a_jittering_line_are_timed_by_the_controller_s_count(bench):
    bench.block.place_order(SearchOrder(1, HOME, HOME, 1.0, (0,) * 8))
    record = SearchRecord(bench.block, 1)
    delays_ns = [0 if i % 3 == 0 else 900_000 + 10_000 * i for i in range(30)]
    bench.responder.take_order()
    for i, delay_ns in enumerate(delays_ns):
        bench.block.add_sample(Sample(1, 5000 + 4 * i, 77_000_000 + 4_000_000 * i + delay_ns, HOME))
    bench.block.words[Slot.IPOC_STEP], bench.block.words[Slot.CYCLE] = 4, 4_000_000
    record.collect()
    result = record.result(SearchEnd.TRAVEL, bench.block.status(), HOME)
    assert result.times_ns == tuple(77_000_000 + 4_000_000 * i for i in range(30))


def test_a_search_longer_than_the_ring_loses_nothing_while_it_is_collected(bench):
    record = SearchRecord(bench.block, 1)
    for count in range(2 * ROWS):
        bench.block.add_sample(Sample(1, count, count, HOME))
        if count % 1000 == 0:
            record.collect()
    record.collect()
    assert [sample.ipoc for sample in record.samples] == list(range(2 * ROWS))
