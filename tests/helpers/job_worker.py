"""A worker with operations for tests of jobs: `python -P job_worker.py OPERATION`."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parents[2]))

from cellctl.files import InputError, Problem
from cellctl.operations.worker import Tell, main

COMMAND = (sys.executable, "-P", __file__)


def count(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """Report each number up to `to`; print to stdout and stderr beside it."""
    for number in range(request["to"]):
        tell({"doing": f"number {number}", "share": number / request["to"]})
    print("printed")
    print("warned", file=sys.stderr)
    return {"counted": request["to"], "letters": "x" * request.get("letters", 0)}


def refuse(request: dict[str, Any], tell: Tell) -> None:
    """Refuse the file of the request."""
    raise InputError(Problem(request["file"], 7, 0, "is wrong", "correct it"))


def break_down(request: dict[str, Any], tell: Tell) -> None:
    """An error of the program."""
    raise KeyError("lost")


def wait_for_ever(request: dict[str, Any], tell: Tell) -> None:
    """Run until it is ended; write a file when the end is asked for."""
    try:
        tell({"doing": "waiting", "share": 0.5})
        while True:
            threading.Event().wait(60)
    finally:
        Path(request["cleaned"]).write_text("yes")


def write_later(request: dict[str, Any], tell: Tell) -> None:
    """Wait until the file `go` is there, then report, and write the file `done`."""
    tell({"doing": "ready", "share": 0.0})
    while not Path(request["go"]).exists():
        threading.Event().wait(0.02)
    for _ in range(1000):
        tell({"line": "x" * 100})
    Path(request["done"]).write_text("yes")


if __name__ == "__main__":
    names = ("count", "refuse", "break_down", "wait_for_ever", "write_later")
    sys.exit(main({name: f"tests.helpers.job_worker:{name}" for name in names}))
