"""Units on a Dask cluster: a local one, or one whose scheduler has an address.

The client keeps what is not done, so that nothing is lost with a worker or the scheduler: the scheduler gives the tasks
of a lost worker to another; a lost scheduler is waited for, and all units without a row are submitted to it again. A
unit that was computed twice has one row (`runner.computed`).
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, suppress
from typing import Any, final

from cellctl.files import InputError, Problem
from cellctl.installed import has_package
from cellctl.operations.studies.runner import Compute, Row, Work, as_line

AHEAD = 2
"""Tasks submitted for each thread of the cluster: one waits there while one is computed."""

LOOK_S = 2.0
"""Between two looks at scheduler and workers, s."""

CONNECT_S = 30.0
"""For one attempt to reach the scheduler, s; where it is lost, attempts are repeated until it is there."""

ANSWER_S = 10.0
"""For the result of a task that is done, and for the end of a connection, s."""

RESTART_S = 24 * 3600
"""After so long without its worker a local cluster gives a place up, s. Within Dask's own 15 s a busy computer does not
start a worker twice: all places would be given up, and the study would wait for ever."""

HERE = "127.0.0.1:0"
"""Dask's pages of a local cluster: seen from this computer alone, at any free port."""

CURE = "install them with `pip install 'cellctl[study]'`, or give --processes N: it computes without them"


def refuse_without_dask() -> None:
    """Raise InputError where dask or distributed is missing."""
    if missing := [name for name in ("dask", "distributed") if not has_package(name)]:
        what = f"a study computes on a Dask cluster, and this is not installed: {', '.join(missing)}"
        raise InputError(Problem("cellctl study", 0, 0, what, CURE))


def on_cluster(scheduler: str | None, workers: int, told: Callable[[str], None]) -> Compute:
    """Computes on the cluster of the scheduler at `tcp://…`; None: on one of `workers` processes here.

    told: takes what a person has to know, once each time it begins. Raises InputError for a unit that ends its
    workers, and where the scheduler cannot be reached at first.
    """
    refuse_without_dask()

    def compute(work: Work, units: Sequence[Row]) -> Iterator[tuple[Row, str]]:
        import dask  # an extra: it may be missing
        from distributed import LocalCluster  # an extra: it may be missing

        with ExitStack() as stack:
            address = scheduler
            if address is None:
                stack.enter_context(dask.config.set({"distributed.deploy.lost-worker-timeout": RESTART_S}))
                cluster = LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address=HERE,
                    worker_dashboard_address=HERE,
                    silence_logs=logging.CRITICAL,
                )
                address = stack.enter_context(cluster).scheduler_address
            yield from _Client(address, told).computed(work, units)

    return compute


@final
class _Client:
    """A connection to a scheduler, made again when it is lost."""

    def __init__(self, address: str, told: Callable[[str], None]) -> None:
        self._address, self._told, self._last = address, told, ""
        self._client: Any = None
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # it logs each lost worker with a traceback

    def computed(self, work: Work, units: Sequence[Row]) -> Iterator[tuple[Row, str]]:
        from distributed import wait  # an extra: it may be missing

        lost = (OSError, TimeoutError, CancelledError, RuntimeError)
        self._client = self._connected(first=True)
        waiting, running = [*reversed(units)], dict[Any, Row]()
        try:
            while waiting or running:
                done: list[tuple[Any, str]] = []
                try:
                    self._submit(work, waiting, running)
                    with suppress(TimeoutError), self._client.as_current():
                        wait(list(running), timeout=LOOK_S, return_when="FIRST_COMPLETED")
                    for future in [each for each in running if each.done()]:
                        with suppress(TimeoutError):  # its worker was lost with its result: it is computed again
                            done.append((future, self._result(future, running[future])))
                except _Failed as failed:
                    raise failed.error from None
                except lost:
                    self._say(f"the scheduler {self._address} is lost: waiting for it")
                    waiting += [unit for future, unit in running.items() if future not in dict(done)][::-1]
                    yield from ((running[future], line) for future, line in done)
                    running.clear()
                    self._closed()
                    self._client = self._connected()
                    continue
                for future, line in done:
                    yield running.pop(future), line
                    future.release()
        finally:
            with suppress(*lost):
                self._client.cancel(list(running), force=True)
            self._closed()

    def _closed(self) -> None:
        with suppress(OSError, TimeoutError, CancelledError, RuntimeError):
            self._client.close(timeout=ANSWER_S)

    def _submit(self, work: Work, waiting: list[Row], running: dict[Any, Row]) -> None:
        threads = sum(each["nthreads"] for each in self._client.scheduler_info(n_workers=-1)["workers"].values())
        if self._client.status != "running":
            raise OSError("the connection was closed")
        self._say("" if threads else f"the scheduler {self._address} has no workers: waiting for some")
        while waiting and len(running) < max(AHEAD * threads, 1):
            unit = waiting.pop()
            key = f"cellctl-{hashlib.sha256(as_line(unit).encode()).hexdigest()[:16]}-{id(self)}"
            running[self._client.submit(work, unit, key=key, pure=False)] = unit

    def _result(self, future: Any, unit: Row) -> str:
        """The line of a unit. Raises what its computation raised; CancelledError where it was lost."""
        from distributed import KilledWorker  # an extra: it may be missing

        if future.status == "error" and isinstance(future.exception(), KilledWorker):
            what = f"workers end without a word when they compute {as_line(unit).strip()}"
            cure = "look for memory and limits of the workers; the same call continues with what is not done"
            raise InputError(Problem("cellctl study", 0, 0, what, cure)) from future.exception()
        if future.status not in ("finished", "error"):
            raise CancelledError
        if future.status == "error":
            raise _Failed(future.exception())
        return str(future.result(timeout=ANSWER_S))

    def _connected(self, *, first: bool = False) -> Any:
        """A client of the scheduler. Raises InputError where it cannot be reached `first`."""
        from distributed import Client  # an extra: it may be missing

        while True:
            try:
                client = Client(self._address, timeout=CONNECT_S, set_as_default=False)
            except (OSError, ValueError) as error:
                if first:
                    what = f"no scheduler answers at {self._address}"
                    cure = "start one with `dask scheduler`, and give its address, such as tcp://127.0.0.1:8786"
                    raise InputError(Problem("--scheduler", 0, 0, what, cure)) from error
            else:
                return client

    def _say(self, text: str) -> None:
        if text and text != self._last:
            self._told(text)
        self._last = text


class _Failed(Exception):
    """A unit raised an exception; it is not one of the connection's."""

    def __init__(self, error: BaseException) -> None:
        super().__init__(str(error))
        self.error = error
