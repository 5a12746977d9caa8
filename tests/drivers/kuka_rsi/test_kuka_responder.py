"""What the cyclic process does with its socket and its slots, in the test's own process and time."""

from __future__ import annotations

import math
import os
import re
import socket
from collections.abc import Callable, Sequence
from typing import final

import pytest

from cellctl.devices import SearchEnd
from drivers.kuka_rsi.cyclic import process
from drivers.kuka_rsi.cyclic.limits import Correction, SearchLimits
from drivers.kuka_rsi.cyclic.responder import ControllerLine, Responder
from drivers.kuka_rsi.cyclic.search_cycle import SearchCycle
from drivers.kuka_rsi.cyclic.session import Admission, Cause, CycleTiming, CyclicTask, Phase, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import ROWS, Sample, SharedBlock, Slot
from drivers.kuka_rsi.cyclic.telegram import ReplyFormat, Telegram
from drivers.kuka_rsi.robot.searching import SearchRecord

HOME = (0.0,) * 6
TEMPLATE = (
    '<Sen><AK A1="{0:.6f}" A2="{1:.6f}" A3="{2:.6f}" A4="{3:.6f}" A5="{4:.6f}" A6="{5:.6f}"/>'
    "<Stop>{6:d}</Stop><IPOC>{7}</IPOC></Sen>"
)


class Bench:
    """A responder on a loopback socket, a controller's socket beside it, and a clock set by hand."""

    def __init__(self, task_of: Callable[[SearchOrder], CyclicTask]) -> None:
        self.line = ControllerLine.bind("127.0.0.1", 0, "127.0.0.1")
        self.controller = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.controller.settimeout(60)
        self.block, fd = SharedBlock.create()
        os.close(fd)
        self.now_ns = 0
        self.reading_takes_ns = 0
        self.ipoc = 1000
        self.offset = 0.0
        self.late = 0
        self.responder = Responder(self.line, self.block, ReplyFormat(TEMPLATE), self.clock, task_of)

    def clock(self) -> int:
        self.now_ns += self.reading_takes_ns
        return self.now_ns

    def order(self, number: int = 1) -> None:
        self.block.place_order(SearchOrder(number, HOME, (1.0, 0, 0, 0, 0, 0), 2.0, (0,) * 8))
        self.block.announce_session(number)

    def send(self) -> None:
        self.ipoc += 4
        self.now_ns += 4_000_000
        self.controller.sendto(self.telegram(), self.line.place)

    def telegram(self) -> bytes:
        axes = " ".join(f'A{i}="{self.offset if i == 1 else 0:.4f}"' for i in range(1, 7))
        late = f'<Delay D="{self.late}"/>' if self.late else ""
        return f'<Rob Type="KUKA"><AIPos {axes}/>{late}<IPOC>{self.ipoc}</IPOC></Rob>'.encode()

    def receive(self) -> tuple[int, float, bool]:
        """Count, correction of A1 and stop of the next reply."""
        reply = self.controller.recv(65535)
        values = re.search(rb'A1="([^"]*)".*<Stop>(\d)</Stop><IPOC>(\d+)<', reply)
        self.offset = float(values[1])
        return int(values[3]), self.offset, values[2] == b"1"

    def nothing_came(self) -> bool:
        """Whether the controller got no answer."""
        self.controller.setblocking(False)
        try:
            self.controller.recv(65535)
        except BlockingIOError:
            return True
        finally:
            self.controller.settimeout(60)
        return False

    def unanswered(self) -> bool:
        """Sends one more telegram; whether it was not answered."""
        self.send()
        self.responder.answer()
        return self.nothing_came()

    def cycle(self) -> tuple[int, float, bool]:
        self.send()
        self.responder.answer()
        return self.receive()


@final
class Nod:
    """A task that is no search: it swings axis 1 to and fro, and leaves when it is stopped."""

    def __init__(self, order: SearchOrder) -> None:
        self.number, self.swing_deg = order.number, order.correction[0]
        self.phase, self.cause = Phase.MOVING, Cause.NONE
        self.detail = self.age_ns = self.stop_cycles = self.missed = 0
        self.timing = CycleTiming()

    def admit(self, telegram: Telegram) -> Admission:
        return Admission.ANSWERABLE

    def answer(
        self, telegram: Telegram, now_ns: int, stopped: bool, beats: Sequence[int], *, leave: bool = False
    ) -> tuple[Correction, bool]:
        if stopped:
            self.cause, self.phase = Cause.STOPPED, Phase.LEAVING
        self.swing_deg = -self.swing_deg
        return (self.swing_deg, *HOME[1:]), self.phase is Phase.LEAVING


@pytest.fixture
def task_of() -> Callable[[SearchOrder], CyclicTask]:
    return lambda order: SearchCycle(order, SearchLimits())


@pytest.fixture
def bench(task_of):
    bench = Bench(task_of)
    yield bench
    bench.line.close()
    bench.controller.close()


def test_of_several_waiting_telegrams_only_the_newest_is_answered(bench):
    bench.order()
    for _ in range(20):
        bench.cycle()
    for bench.late in range(4):
        bench.send()
    bench.responder.answer()
    assert bench.receive()[0] == bench.ipoc
    assert bench.nothing_came()
    assert bench.block.words[Slot.SKIPPED] == 3
    assert bench.block.words[Slot.LOST] == 0
    assert len(bench.block.samples(0)[0]) == 24


def test_without_an_order_no_telegram_is_answered(bench):
    assert bench.unanswered()
    assert bench.block.words[Slot.HEAD] == 0
    assert bench.block.words[Slot.TELEGRAMS] == 1


def test_an_ordered_search_is_not_answered_before_its_session_is_announced(bench):
    bench.block.place_order(SearchOrder(1, HOME, (1.0, 0, 0, 0, 0, 0), 2.0, (0,) * 8))
    assert bench.unanswered()
    assert bench.responder.waits_for_announcement
    bench.block.announce_session(1)
    bench.now_ns += 3_000_000
    bench.responder.answer()
    assert bench.receive() == (bench.ipoc, 0.0, False)
    assert not bench.responder.waits_for_announcement


def test_a_telegram_of_an_earlier_cycle_is_not_answered_once_its_session_is_announced(bench):
    bench.block.place_order(SearchOrder(1, HOME, (1.0, 0, 0, 0, 0, 0), 2.0, (0,) * 8))
    assert bench.unanswered()
    bench.now_ns += 4_000_000
    bench.block.announce_session(1)
    bench.responder.answer()
    assert bench.nothing_came()
    assert bench.cycle() == (bench.ipoc, 0.0, False)


def test_telegrams_left_over_from_another_session_do_not_end_the_one_announced(bench):
    bench.send()
    bench.ipoc += 500_000
    bench.send()
    bench.order()
    bench.responder.answer()
    assert bench.receive() == (bench.ipoc, 0.0, False)
    for _ in range(20):
        bench.cycle()
    assert bench.offset > 0


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


def test_a_stop_that_is_not_cleared_stops_every_later_search(bench):
    bench.block.words[Slot.STOP] = 1
    bench.order(2)
    for _ in range(30):
        bench.cycle()
    assert bench.cycle()[1] == 0.0


def test_after_the_release_nothing_is_answered(bench):
    bench.order()
    for _ in range(300):
        bench.cycle()
    assert bench.offset > 0
    bench.block.release()
    assert bench.unanswered()


def test_a_telegram_is_answered_once_and_an_overtaken_one_not_at_all(bench):
    bench.order()
    for _ in range(50):
        bench.cycle()
    samples = bench.block.words[Slot.HEAD]
    bench.ipoc -= 8
    assert bench.unanswered()
    assert bench.unanswered()
    assert bench.block.words[Slot.STALE] == 2
    assert bench.block.words[Slot.HEAD] == samples


def test_after_a_gap_beyond_the_tolerance_nothing_is_answered_any_more(bench):
    bench.order()
    for _ in range(100):
        bench.cycle()
    bench.ipoc += 100_000
    assert bench.unanswered()
    assert bench.unanswered()
    assert (bench.block.status().cause, bench.block.status().phase) == (Cause.LOST, Phase.OVER)
    assert bench.block.status().detail == 100_004
    assert bench.block.words[Slot.BEYOND] == 2


def test_a_stall_beyond_the_tolerance_ends_the_session_whatever_waits_in_between(bench):
    bench.order()
    for _ in range(100):
        bench.cycle()
    for bench.late in range(101):
        bench.send()
    bench.responder.answer()
    assert bench.nothing_came()
    assert bench.block.status().cause is Cause.LOST


def test_a_second_sender_at_the_controller_s_address_is_not_answered_and_named(bench):
    bench.order()
    for _ in range(50):
        bench.cycle()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        bench.ipoc += 4
        other.sendto(bench.telegram(), bench.line.place)
        bench.responder.answer()
        other.setblocking(False)
        with pytest.raises(BlockingIOError):
            other.recv(65535)
        assert bench.block.foreign_sender() == f"127.0.0.1:{other.getsockname()[1]}"
    assert bench.block.words[Slot.FOREIGN] == 1
    bench.ipoc -= 4
    assert bench.cycle()[0] == bench.ipoc


def test_telegrams_from_another_address_are_counted_and_named_also_where_the_kernel_drops_them(bench):
    bench.order()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.2", 0))
        for _ in range(40):
            other.sendto(bench.telegram(), bench.line.place)
            bench.responder.answer()
        assert bench.block.foreign_sender() == f"127.0.0.2:{other.getsockname()[1]}"
    assert bench.block.words[Slot.FOREIGN] == 40
    assert bench.block.words[Slot.TELEGRAMS] == 0
    assert bench.cycle() == (bench.ipoc, 0.0, False)


def test_everything_shown_is_shown_before_the_answer_leaves(bench, monkeypatch):
    """In lockstep the cell's time goes on with the answer: what changes after it would differ from run to run."""
    bench.order()
    shown = []
    send = ControllerLine.send

    def noting(self, reply, place):
        shown.append(bytes(bench.block.words[: Slot.RING]))
        send(self, reply, place)

    monkeypatch.setattr(ControllerLine, "send", noting)
    for _ in range(30):
        bench.cycle()
        assert bytes(bench.block.words[: Slot.RING]) == shown[-1]


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


@pytest.mark.parametrize("task_of", [Nod])
def test_another_task_than_a_search_answers_by_its_own_rule_with_no_line_changed_around_it(bench):
    bench.order(number=5)
    assert [bench.cycle()[1:] for _ in range(3)] == [(-1.0, False), (1.0, False), (-1.0, False)]
    assert bench.block.status().phase is Phase.MOVING
    bench.block.words[Slot.STOP] = 5
    assert bench.cycle()[2]
    assert (bench.block.status().number, bench.block.status().cause) == (5, Cause.STOPPED)
    bench.block.release()
    assert bench.unanswered()


class Holding:
    """A responder that holds a search for some more answers."""

    waits_for_announcement = False

    def __init__(self, more: float) -> None:
        self.more = more
        self.left: list[bool] = []

    @property
    def busy(self) -> bool:
        return len(self.left) < self.more

    def answer(self, *, leave: bool) -> None:
        self.left.append(leave)


@pytest.fixture
def telegram_waits():
    """A line at which a telegram always waits."""
    line, controller = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    controller.send(b"<Rob/>")
    yield line
    line.close()
    controller.close()


def test_a_process_that_is_to_exit_answers_until_its_search_is_released(telegram_waits):
    responder = Holding(more=5)
    process._serve(telegram_waits, responder, True)
    assert responder.left == [True] * 5


def test_a_process_that_is_to_exit_does_not_wait_for_a_silent_controller(telegram_waits):
    telegram_waits.recv(100)
    responder = Holding(more=math.inf)
    process._serve(telegram_waits, responder, True)
    assert responder.left == [True]


def test_a_search_that_is_never_released_delays_the_exit_for_a_limited_time(telegram_waits, monkeypatch):
    monkeypatch.setattr(process, "_LEAVE_S", 0.02)
    responder = Holding(more=math.inf)
    process._serve(telegram_waits, responder, True)
    assert len(responder.left) > 1
