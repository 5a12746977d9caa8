"""A child process of a test, which ends with it."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def child(command: Sequence[str | Path], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A `Popen` of `command`, killed where the block leaves it running: the `with` of a Popen would wait for its end,
    so a test that failed would hang, with an engine and its simulators at full load."""
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            process.kill()
