"""Files of JSON objects that only grow, one object for each line: commands, alarms, planned runs, notes."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from cellctl.files.writing import append_line


@final
@dataclass(frozen=True, slots=True)
class JsonLines:
    """The file `path`; several processes may add to it."""

    path: Path

    @property
    def stamp(self) -> tuple[int, int]:
        """Another one after each change: inode and size; zeros if there is no file."""
        try:
            found = self.path.stat()
        except OSError:
            return 0, 0
        return found.st_ino, found.st_size

    def append(self, data: dict[str, Any]) -> None:
        """Add a line, durable on return; the folder is made if it is missing. Raises OSError."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        append_line(self.path, json.dumps(data, ensure_ascii=False))

    def read(self, name: str = "") -> Iterator[dict[str, Any]]:
        """The objects, oldest first; name: only those with a text of this name.

        What is left of a line that a full disk cut is passed over.
        """
        try:
            lines = self.path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError:  # there is none yet, or it cannot be read: who adds a line hears of that
            return
        for line in lines:
            try:
                data = json.loads(line)
            except ValueError:
                continue
            if isinstance(data, dict) and (not name or isinstance(data.get(name), str)):
                yield data


@final
class FollowedLines:
    """The file `path`, whose objects with an `id` are read again when it has changed. Belongs to one event loop."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lines = JsonLines(path)
        self._stamp = (0, 0)

    async def append(self, data: dict[str, Any]) -> None:
        """Add a line, durable on return. Raises OSError."""
        await asyncio.to_thread(self._lines.append, data)

    async def changed(self) -> list[dict[str, Any]] | None:
        """All objects, oldest first, if the file has changed since the last call; None: it has not."""
        stamp = await asyncio.to_thread(lambda: self._lines.stamp)
        if stamp == self._stamp:
            return None
        self._stamp = stamp
        return await asyncio.to_thread(lambda: list(self._lines.read("id")))
