"""The kernel of the simulated cell: the order of events, and when time stands still."""

import itertools
import socket
import threading
import time

import pytest

from sims import kernel as kernel_module
from sims.kernel import Kernel

MS = 1_000_000


@pytest.fixture(params=["lockstep", "realtime"])
def any_kernel(request):
    kernel = Kernel(request.param)
    yield kernel
    kernel.close()


@pytest.fixture
def lockstep():
    kernel = Kernel("lockstep")
    yield kernel
    kernel.close()


@pytest.fixture
def peer(lockstep):
    """A host that has just been heard, so that T is not paced by the wall."""
    ours, theirs = socket.socketpair()
    lockstep.watch(ours, lambda: ours.recv(100))
    theirs.send(b"hello")
    yield theirs
    ours.close()
    theirs.close()


def test_events_run_in_the_order_of_their_times_and_of_asking_among_equals(any_kernel):
    seen = []
    for name, at in [("c", 3), ("a", 1), ("b1", 2), ("b2", 2)]:
        any_kernel.at(at, lambda name=name: seen.append((name, any_kernel.now)))
    any_kernel.at(4, any_kernel.stop)
    any_kernel.run()
    assert seen == [("a", 1), ("b1", 2), ("b2", 2), ("c", 3)]


def test_a_cancelled_event_does_not_run_even_in_its_own_instant(any_kernel):
    seen = []
    later = None
    any_kernel.at(1, lambda: later.cancel())
    later = any_kernel.at(1, lambda: seen.append("never"))
    any_kernel.at(2, any_kernel.stop)
    any_kernel.run()
    assert seen == []


def test_an_event_asked_for_in_the_past_runs_now_and_time_does_not_go_back(any_kernel):
    seen = []
    any_kernel.at(5 * MS, lambda: any_kernel.at(1, lambda: (seen.append(any_kernel.now), any_kernel.stop())))
    any_kernel.run()
    assert seen[0] >= 5 * MS


def test_time_is_published_before_anything_happens_at_it():
    published = []
    kernel = Kernel("lockstep", published.append)
    kernel.at(7, lambda: seen.append(list(published)))
    seen = []
    kernel.at(8, kernel.stop)
    kernel.run()
    kernel.close()
    assert seen == [[0, 7]]


def test_time_stands_still_until_the_hold_is_released(lockstep, peer):
    seen = []
    ours, theirs = socket.socketpair()

    def ask():
        hold = lockstep.hold("host")
        lockstep.watch(ours, lambda: (ours.recv(1), seen.append(lockstep.now), hold.release()))
        lockstep.every_half_second(lambda: theirs.send(b"!"))  # long after, on the wall

    lockstep.at(10 * MS, ask)
    lockstep.at(11 * MS, lambda: (seen.append(lockstep.now), lockstep.stop()))
    lockstep.run()
    ours.close()
    theirs.close()
    assert seen == [10 * MS, 11 * MS]


def test_a_silent_peer_is_given_up_and_waited_for_again_once_heard(lockstep, monkeypatch):
    monkeypatch.setattr(kernel_module, "PATIENCE_NS", 20 * MS)
    seen = []

    def ask():
        hold = lockstep.hold("host")
        lockstep.at(2 * MS, lambda: seen.append((hold.active, lockstep.is_dead("host"))))
        lockstep.at(3 * MS, lambda: seen.append(lockstep.hold("host").active))
        lockstep.at(4 * MS, lambda: (lockstep.alive("host"), seen.append(lockstep.hold("host").active)))
        lockstep.at(5 * MS, lockstep.stop)

    lockstep.at(1 * MS, ask)
    lockstep.run()
    assert seen == [(False, True), False, True]


def test_a_silent_peer_is_given_up_though_another_talks_on(lockstep, peer, monkeypatch):
    monkeypatch.setattr(kernel_module, "PATIENCE_NS", 20 * MS)
    ours, theirs = socket.socketpair()
    lockstep.watch(ours, lambda: (ours.recv(1), theirs.send(b"!")))  # readable again at once, for ever
    theirs.send(b"!")
    lockstep.at(MS, lambda: lockstep.hold("host"))
    lockstep.at(2 * MS, lockstep.stop)
    lockstep.run()
    assert lockstep.is_dead("host")
    ours.close()
    theirs.close()


def test_after_a_stall_of_the_whole_computer_a_peer_still_has_its_time_to_answer(lockstep, monkeypatch):
    wall, select, stalls = time.monotonic_ns, lockstep._selector.select, [0]

    def stalled(wait_s):
        ready = select(min(wait_s, 0.01))
        if lockstep.holders() and not stalls[-1]:
            stalls.append(3 * kernel_module.PATIENCE_NS)
        return ready

    monkeypatch.setattr(lockstep._selector, "select", stalled)
    monkeypatch.setattr(kernel_module.time, "monotonic_ns", lambda: wall() + stalls[-1])
    seen = []
    lockstep.at(MS, lambda: lockstep.every_half_second(lockstep.hold("host").release))
    lockstep.at(2 * MS, lambda: (seen.append(lockstep.is_dead("host")), lockstep.stop()))
    lockstep.run()
    assert stalls[-1]
    assert seen == [False]


def test_in_real_time_nothing_holds():
    kernel = Kernel("realtime")
    assert not kernel.hold("host").active
    kernel.close()


def test_with_nobody_to_be_heard_time_is_no_faster_than_the_wall(lockstep):
    began = time.monotonic_ns()
    lockstep.at(60 * MS, lockstep.stop)
    lockstep.run()
    assert time.monotonic_ns() - began >= 60 * MS


def test_with_somebody_to_be_heard_time_leaps(lockstep, peer):
    began = time.monotonic_ns()
    lockstep.at(MS, lambda: lockstep.at(3_600_000 * MS, lockstep.stop))
    lockstep.run()
    assert time.monotonic_ns() - began < 60_000 * MS  # an hour of T


def test_in_real_time_an_event_is_never_early():
    kernel = Kernel("realtime")
    lateness = []
    for k in range(1, 6):
        kernel.at(k * 4 * MS, lambda due=k * 4 * MS: lateness.append(time.monotonic_ns() - kernel.epoch_ns - due))
    kernel.at(21 * MS, kernel.stop)
    kernel.run()
    kernel.close()
    assert len(lateness) == 5
    assert min(lateness) >= 0


def test_stop_from_elsewhere_wakes_a_kernel_that_waits(lockstep):
    lockstep.hold("host")
    lockstep.every_half_second(lockstep.stop)
    lockstep.run()
    assert lockstep.now == 0


@pytest.fixture
def answering():
    """A real-time kernel that asks a question each 4 ms of T, and a peer that answers each at once."""
    kernel = Kernel("realtime")
    ours, theirs = socket.socketpair()
    asked, answered = [], []

    def ask():
        asked.append(kernel.now)
        holds.append(kernel.hold_for_answer("pc", 4 * MS))
        theirs.send(b"!")
        if len(asked) < 30:
            kernel.after(4 * MS, ask)
        else:
            kernel.after(4 * MS, kernel.stop)

    def hear():
        answered.append((ours.recv(1), len(asked)))
        holds[-1].release()

    holds = []
    kernel.watch(ours, hear)
    kernel.at(4 * MS, ask)
    yield kernel, asked, answered
    kernel.close()
    ours.close()
    theirs.close()


def test_in_real_time_a_stall_of_the_simulator_leaves_its_peer_time_to_answer_each_question(answering):
    kernel, asked, answered = answering
    kernel.at(41 * MS, lambda: threading.Event().wait(0.06))  # as if the process had been stopped
    kernel.run()
    assert [question for _, question in answered] == list(range(1, len(asked) + 1))
    assert [b - a for a, b in itertools.pairwise(asked)] == [4 * MS] * (len(asked) - 1)


def test_in_real_time_a_peer_that_does_not_answer_holds_nothing_up_for_longer_than_its_time():
    kernel = Kernel("realtime")
    seen = []
    kernel.at(1 * MS, lambda: kernel.hold_for_answer("pc", 4 * MS))
    kernel.at(2 * MS, lambda: seen.append("another device"))
    kernel.at(5 * MS, lambda: (seen.append("next question"), kernel.stop()))
    kernel.run()
    kernel.close()
    assert seen == ["another device", "next question"]
