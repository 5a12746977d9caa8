"""Aborts a run when its parent process ends in any way, unless the run was started detached."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_LOOK_S = 0.5
"""Wall time between two checks, s: processes use wall time."""


def parent_of_run(*, detached: bool) -> int | None:
    """The process whose end aborts a run that begins now; None if the run was started detached.

    That is: with `--detached`, by nohup (SIGHUP is ignored), or in a session of its own (setsid, a service manager).
    """
    return None if detached or under_nohup() or os.getsid(0) == os.getpid() else os.getppid()


def under_nohup() -> bool:
    """Whether this process was started by nohup: SIGHUP is ignored."""
    return signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


@contextmanager
def aborting_without(parent: int | None, abort: Callable[[str], object]) -> Iterator[None]:
    """Inside this context, call `abort` once with the reason if `parent` ends, from a separate thread."""
    if parent is None:
        yield
        return
    over = threading.Event()
    watch = threading.Thread(target=_watch, args=(parent, _name_of(parent), abort, over), daemon=True)
    watch.start()
    try:
        yield
    finally:
        over.set()
        watch.join()


def _watch(parent: int, name: str, abort: Callable[[str], object], over: threading.Event) -> None:
    while not over.wait(_LOOK_S):
        if os.getppid() != parent:  # the parent id changes when the parent ends
            abort(
                f"aborted: process {parent}{name}, which started this run, has ended "
                "(start with --detached if the run is to continue without it)"
            )
            return


def _name_of(process: int) -> str:
    with suppress(OSError):
        return f" ({Path(f'/proc/{process}/comm').read_text().strip()})"
    return ""
