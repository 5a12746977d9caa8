"""What the cyclic process takes of real time where it is permitted, and reports where it is not."""

from __future__ import annotations

import ctypes
import gc
import os

import pytest

from drivers.kuka_rsi.cyclic import real_time


@pytest.fixture
def kernel(monkeypatch, tmp_path):
    """Records what is asked of the kernel; `refuses` names what it does not permit."""

    class Kernel:
        def __init__(self):
            self.asked, self.refuses, self.isolated = {}, set(), tmp_path / "isolated"

        def mlockall(self, flags):
            self.asked["mlock"] = flags
            return -1 if "mlock" in self.refuses else 0

        def scheduler(self, pid, policy, parameters):
            self.take("fifo", policy)

        def affinity(self, pid, processors):
            self.take("affinity", processors)

        def take(self, what, value):
            self.asked[what] = value
            if what in self.refuses:
                raise PermissionError

    kernel = Kernel()
    kernel.isolated.write_text("\n")
    monkeypatch.setattr(real_time, "_ISOLATED", kernel.isolated)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: kernel)
    monkeypatch.setattr(os, "sched_setscheduler", kernel.scheduler)
    monkeypatch.setattr(os, "sched_setaffinity", kernel.affinity)
    monkeypatch.setattr(real_time.resource, "setrlimit", lambda *_: None)
    for name in ("collect", "freeze", "disable"):
        monkeypatch.setattr(gc, name, lambda: None)
    return kernel


def test_what_is_permitted_is_taken(kernel):
    kernel.isolated.write_text("1,3-5\n")
    assert real_time.become_real_time() == {"fifo": True, "mlock": True, "affinity": True}
    assert (kernel.asked["fifo"], kernel.asked["affinity"]) == (os.SCHED_FIFO, {5})


def test_what_is_not_permitted_is_reported_and_hinders_nothing(kernel):
    kernel.isolated.write_text("1")
    kernel.refuses = {"fifo", "mlock", "affinity"}
    assert real_time.become_real_time() == {"fifo": False, "mlock": False, "affinity": False}


def test_without_an_isolated_processor_it_is_not_pinned(kernel):
    assert not real_time.become_real_time()["affinity"]
    assert "affinity" not in kernel.asked


@pytest.mark.parametrize(("hard", "flags"), [(-1, 3), (8192, 1)])
def test_memory_to_come_is_locked_only_where_no_bound_could_make_it_fail(kernel, monkeypatch, hard, flags):
    monkeypatch.setattr(real_time.resource, "getrlimit", lambda _: (4096, hard))
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    real_time.become_real_time()
    assert kernel.asked["mlock"] == flags
