"""Units on a real Dask cluster of processes on this computer: whatever is lost, each unit has one row in the end."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial

import pytest

from cellctl.files import InputError
from cellctl.operations.studies import cluster
from cellctl.operations.studies.runner import as_line, computed, each, load
from tests.helpers import study_units
from tests.helpers.runs import ROOT, child

pytestmark = pytest.mark.long

PATIENCE_S = 240
"""Against hangs only."""

QUIET = ("--no-dashboard", "--dashboard-address", "127.0.0.1:0")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Cluster:
    """A scheduler and workers without nannies, each a process that a test may kill."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack, self._port = stack, free_port()
        self.address = f"tcp://127.0.0.1:{self._port}"
        self.workers: list[subprocess.Popen[bytes]] = []

    def start_scheduler(self) -> subprocess.Popen[bytes]:
        started = self._started("dask_scheduler", "--port", str(self._port), *QUIET)
        until(lambda: listens(self._port))
        return started

    def start_worker(self) -> None:
        words = (self.address, "--no-nanny", "--nthreads", "1", *QUIET)
        self.workers.append(self._started("dask_worker", *words))

    def kill_workers(self) -> None:
        for each_one in self.workers:
            each_one.kill()
            each_one.wait()
        self.workers.clear()

    def _started(self, module: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{module}", *words, "--host", "127.0.0.1"]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return self._stack.enter_context(child(command, env=environment, cwd=ROOT, **quiet))


@pytest.fixture
def a_cluster():
    with ExitStack() as stack:
        found = Cluster(stack)
        found.scheduler = found.start_scheduler()
        found.start_worker()
        yield found


def until(true: Callable[[], object], working: Future[object] | None = None) -> None:
    for _ in range(PATIENCE_S * 20):
        if true():
            return
        if working and working.done():
            working.result()
        threading.Event().wait(0.05)
    raise AssertionError("it never came")


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_what_is_lost_with_workers_and_scheduler_is_computed_again_and_no_row_is_lost_or_doubled(a_cluster, tmp_path):
    units, file, said = list(each(number=range(1, 13))), tmp_path / "rows.jsonl", []
    for number in (3, 6, 9):
        (tmp_path / f"hold-{number}").touch()
    measure = partial(study_units.held, str(tmp_path))
    compute = cluster.on_cluster(a_cluster.address, 0, said.append)
    pool = ThreadPoolExecutor(1)
    work = pool.submit(computed, measure, units, file, compute, lambda *_: None, {})

    def begun(number: int) -> list[int]:
        """The processes that began it."""
        lines = (tmp_path / "begun").read_text().splitlines() if (tmp_path / "begun").exists() else []
        return [int(line.split()[1]) for line in lines if line.split()[0] == str(number)]

    a_cluster.start_worker()
    until(lambda: begun(3), work)
    os.kill(begun(3)[0], signal.SIGKILL)  # one of two, in this task
    (tmp_path / "hold-3").unlink()
    until(lambda: begun(6), work)
    a_cluster.kill_workers()  # all
    (tmp_path / "hold-6").unlink()
    until(lambda: any("has no workers" in text for text in said), work)
    a_cluster.start_worker()
    until(lambda: begun(9), work)
    a_cluster.scheduler.kill()
    a_cluster.scheduler.wait()
    until(lambda: any("is lost" in text for text in said), work)
    a_cluster.kill_workers()
    (tmp_path / "hold-9").unlink()
    a_cluster.start_scheduler()
    a_cluster.start_worker()
    assert len(work.result(PATIENCE_S)) == 12
    pool.shutdown()
    rows = load(file)
    assert len(begun(3)) >= 2, "the task of the killed worker was begun again"
    assert sorted(rows, key=lambda row: row["number"]) == [{**unit, "root": unit["number"] ** 0.5} for unit in units]
    assert len({as_line(row) for row in rows}) == len(rows) == 12


def test_a_unit_that_ends_its_workers_is_named(tmp_path):
    compute = cluster.on_cluster(None, 1, lambda _: None)
    measure, units = partial(study_units.ends_its_process, str(tmp_path)), [{"number": 7}]
    with pytest.raises(InputError, match='"number": 7'):
        computed(measure, units, tmp_path / "rows.jsonl", compute, lambda *_: None, {})
    assert load(tmp_path / "rows.jsonl") == []


def test_without_a_scheduler_at_its_address_the_study_does_not_begin(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.3)
    with pytest.raises(InputError, match="no scheduler answers"):
        next(cluster.on_cluster(f"tcp://127.0.0.1:{free_port()}", 0, lambda _: None)(str, [{}]))
