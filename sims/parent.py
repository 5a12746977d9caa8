"""Ends a simulated cell when its parent process ends in any way."""

from __future__ import annotations

import ctypes
import os
import signal
from contextlib import suppress

from sims.kernel import Kernel

_PR_SET_PDEATHSIG = 1


def end_with(kernel: Kernel, parent: int) -> None:
    """Stop `kernel` once the process `parent` is gone, be it ours or not."""
    if os.getppid() == parent:
        _die_with_parent()
    with suppress(OSError, AttributeError):
        # sees the end even where nobody has collected the process yet
        kernel.watch(os.pidfd_open(parent), kernel.stop)
    kernel.every_half_second(lambda: None if _exists(parent) else kernel.stop())


def _die_with_parent() -> None:
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _exists(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
