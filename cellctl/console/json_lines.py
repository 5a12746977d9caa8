"""Files of JSON objects that only grow, one object for each line: commands, alarms, planned runs."""

from __future__ import annotations

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

    def read(self) -> Iterator[dict[str, Any]]:
        """The objects that have an `id`, oldest first. What is left of a line that a full disk cut is passed over."""
        try:
            lines = self.path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError:  # there is none yet, or it cannot be read: who adds a line hears of that
            return
        for line in lines:
            try:
                data = json.loads(line)
            except ValueError:
                continue
            if isinstance(data, dict) and isinstance(data.get("id"), str):
                yield data
