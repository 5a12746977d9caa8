"""The loop's voltage: bounces, and the faults that change it."""

import pytest

from sims.bench import catalogue
from sims.faults import Faults
from sims.kernel import Kernel
from sims.probe._firmware import Level, level_of
from sims.probe._server import Circuit
from sims.scene.contact import ContactLoop
from tests.helpers.sims import read_fault

MS = 1_000_000


class Cell:
    """A loop and its faults on a kernel; `seen` collects (T, meaning of the voltage)."""

    def __init__(self, bounce=0, seed=1):
        self.kernel, self.loop = Kernel("lockstep"), ContactLoop()
        self.faults = Faults(self.kernel, catalogue())
        self.circuit = Circuit(self.kernel, self.loop, self.faults, seed, bounce)
        self.seen = []
        self.circuit.on_change = lambda millivolts: self.seen.append((self.kernel.now, level_of(millivolts)))

    def fault(self, name, at_ms, **settings):
        self.faults.schedule(read_fault({"fault": name, "at_ms": at_ms, **settings}))

    def touch(self, at_ms, closed=True):
        self.kernel.at(at_ms * MS, lambda: self.loop.set_closed(closed))

    def run(self, ms=30):
        self.kernel.at(ms * MS, self.kernel.stop)
        self.kernel.run()
        self.kernel.close()
        return self.seen


def test_without_bounce_the_voltage_follows_the_contact_exactly():
    cell = Cell()
    cell.touch(2)
    cell.touch(5, closed=False)
    assert cell.run() == [(2 * MS, Level.CLOSED), (5 * MS, Level.OPEN)]


@pytest.mark.parametrize("bounce", [2, 6])
def test_a_contact_bounces_within_a_millisecond_and_ends_closed(bounce):
    cell = Cell(bounce)
    cell.touch(2)
    seen = cell.run()
    assert seen[0] == (2 * MS, Level.CLOSED)
    assert len(seen) == 1 + bounce
    assert seen[-1][1] is Level.CLOSED
    assert 2 * MS < seen[1][0] <= seen[-1][0] <= 3 * MS


def test_a_contact_let_go_while_it_bounces_ends_open():
    cell = Cell(6)
    cell.touch(2)
    cell.kernel.at(2 * MS + 400_000, lambda: cell.loop.set_closed(False))
    assert cell.run()[-1][1] is Level.OPEN


def test_bounces_come_from_the_seed():
    def seen(seed):
        cell = Cell(4, seed)
        cell.touch(2)
        return cell.run()

    assert seen(1) == seen(1) != seen(2)


def test_a_broken_wire_hides_the_contact_and_then_shows_it():
    cell = Cell()
    cell.fault("probe.wire_break", 1, for_ms=4)
    cell.touch(2)
    assert cell.run() == [(1 * MS, Level.BROKEN), (5 * MS, Level.CLOSED)]


def test_a_dirty_tip_never_closes_the_loop():
    cell = Cell(2)
    cell.fault("probe.no_contact", 1)
    cell.touch(2)
    assert cell.run() == []


def test_a_closed_loop_is_closed_without_contact_for_as_long_as_told():
    cell = Cell()
    cell.fault("probe.closed", 1, for_ms=3)
    assert cell.run() == [(1 * MS, Level.CLOSED), (4 * MS, Level.OPEN)]
