"""What keeps the cyclic process in time: priority, memory that stays, a processor of its own; each where permitted."""

from __future__ import annotations

import ctypes
import gc
import os
import resource

_PRIORITY = 40
_MCL_CURRENT = 1
_MCL_FUTURE = 2


def become_real_time() -> dict[str, bool]:
    """Take what is permitted: `fifo` (SCHED_FIFO), `mlock` (no page is swapped out), `affinity` (one processor).

    Without priority the process is not pinned: it could not leave a processor that another program keeps busy.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    fifo = _take_priority()
    return {"fifo": fifo, "mlock": _lock_memory(), "affinity": fifo and _stay_on_one_processor()}


def _take_priority() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except OSError:
        return False
    return True


def _lock_memory() -> bool:
    """Memory to come is locked only where there is no bound: beyond one, an allocation would fail."""
    _, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    unlimited = hard == resource.RLIM_INFINITY or os.geteuid() == 0
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
    flags = _MCL_CURRENT | (_MCL_FUTURE if unlimited else 0)
    return bool(ctypes.CDLL(None).mlockall(flags) == 0)


def _stay_on_one_processor() -> bool:
    """The one it is on; where it has only one, it is there already."""
    here = ctypes.CDLL(None).sched_getcpu()
    try:
        os.sched_setaffinity(0, {here})
    except OSError:
        return False
    return True
