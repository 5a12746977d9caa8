"""The file in which a cell in lockstep publishes its time to every process of the host."""

from __future__ import annotations

import mmap
import shutil
import tempfile
from pathlib import Path
from typing import final


@final
class TimeFile:
    """An 8-byte little-endian integer, nanoseconds, memory-mapped, in a folder of its own that `close` removes."""

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix="cellsim-")) / "time"
        self.path.write_bytes(bytes(8))
        with self.path.open("r+b") as stream:
            self._map = mmap.mmap(stream.fileno(), 8)
        # one store of a machine word: struct.pack_into would write byte by byte, and a reader could see half a time
        self._word = memoryview(self._map).cast("q")

    def publish(self, now_ns: int) -> None:
        """Write the cell's time."""
        self._word[0] = now_ns

    def close(self) -> None:
        """Remove the file. Readers that have it mapped keep its last value."""
        self._word.release()
        self._map.close()
        shutil.rmtree(self.path.parent, ignore_errors=True)
