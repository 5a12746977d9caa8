"""The cell's state from one simulator process to the next: a file, written atomically."""

from __future__ import annotations

import fcntl
import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO, TypeVar, final

Part = Mapping[str, Any]
"""The state of one part of the cell, as JSON."""


PATIENCE_S = 10.0
"""How long a process waits for the one before it to be gone, which may just be ending with its host."""

Recalled = TypeVar("Recalled")


class BadMemory(ValueError):
    """The file is not the memory of this cell, or is damaged; the text says which."""


@final
class Memory:
    """Each part of the cell registers its state with `keep`, and finds its last state with `recall`.

    `path`: the file, loaded where it exists; None remembers nothing. `whose`: what the memory belongs to; a file of
    another owner is refused. Raises BadMemory, OSError.
    """

    def __init__(self, path: Path | None = None, whose: Part | None = None) -> None:
        self._path = path
        self._whose = dict(whose or {})
        self._recalled = _load(path, self._whose) if path and path.exists() else {}
        self._failed = False
        self._parts: dict[str, Callable[[], Part]] = {}

    def recall(self, part: str, read: Callable[[Any], Recalled]) -> Recalled | None:
        """The last state of `part`, as `read` reads it; None where there is none. Raises BadMemory."""
        if part not in self._recalled:
            return None
        try:
            return read(self._recalled[part])
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            raise BadMemory(f"{self._path} is damaged: {part}: {error!r}") from None

    def keep(self, part: str, state: Callable[[], Part]) -> None:
        """From now on each `save` writes the `state` of `part`."""
        self._parts[part] = state

    def save(self) -> None:
        """Write the state of every part. A failure is reported once: a robot does not stop for a full disk."""
        try:
            self.write()
        except OSError as error:
            if not self._failed:
                print(f"{self._path}: {error.strerror}; the cell is remembered as last written", file=sys.stderr)
            self._failed = True

    def write(self) -> None:
        """`save` whose failure is the caller's. What is written survives the end of the process at any instant.

        Raises OSError.
        """
        if self._path is None:
            return
        text = json.dumps({"cell": self._whose, **{part: state() for part, state in self._parts.items()}})
        unfinished = self._path.with_name(f".{self._path.name}.new")
        unfinished.write_text(text, encoding="utf-8")
        unfinished.replace(self._path)


@contextmanager
def sole_user(path: Path | None) -> Iterator[None]:
    """One process at a time has the memory at `path`; the next waits for a moment. Raises BadMemory, OSError.

    The lock's file names the process that has it.
    """
    if path is None:
        yield
        return
    with path.with_name(f".{path.name}.lock").open("a+") as lock:
        deadline = time.monotonic() + PATIENCE_S
        while not _taken(lock.fileno()):
            if time.monotonic() > deadline:
                raise BadMemory(f"{path} is in use by another simulated cell that runs: {_holder(lock)}")
            threading.Event().wait(0.02)
        lock.truncate(0)
        lock.write(f"{os.getpid()}\n")
        lock.flush()
        yield


def _holder(lock: TextIO) -> str:
    """The process named in the lock's file, with its command line where this system gives it."""
    lock.seek(0)
    process = lock.read().strip()
    try:
        words = Path(f"/proc/{int(process)}/cmdline").read_bytes().rstrip(b"\0").split(b"\0")
    except (OSError, ValueError):
        return f"process {process or '?'}"
    return f"process {process}, {b' '.join(words).decode(errors='replace')}"


def _taken(lock: int) -> bool:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _load(path: Path, whose: Part) -> dict[str, Any]:
    try:
        state = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise BadMemory(f"{path} is damaged: {error}") from None
    if not isinstance(state, dict) or not isinstance(state.get("cell"), dict):
        raise BadMemory(f"{path} is not a simulated cell's memory")
    seed = state["cell"].get("seed")
    if state["cell"] != whose and {**whose, "seed": seed} == state["cell"]:
        other = f"{path} is the memory of this cell with seed {seed}, not with seed {whose['seed']}"
        raise BadMemory(f"{other}: leave --seed out, or give --seed {seed}")
    if state["cell"] != whose:
        raise BadMemory(
            f"{path} is the memory of another cell: {_described(state['cell'])}; this one is {_described(whose)}. "
            "Delete it to begin anew, or name another file"
        )
    return state


def _described(whose: Part) -> str:
    return ", ".join(f"{key} {value}" for key, value in whose.items())
