"""Two processes that do the same work, asked in turn: what their speeds are to each other.

On a shared machine no time means anything alone; two measured in turn in one run are slowed alike.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.helpers.runs import child

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Side:
    """A process that does its work once for every request that it is sent, and answers with figures, in JSON."""

    process: subprocess.Popen[str]

    def work(self, **request: float) -> dict[str, float]:
        """Once, as `request` asks: CPU `seconds` and whatever else it says."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        return self.heard()

    def heard(self) -> dict[str, Any]:
        """The next answer. Raises RuntimeError if the process ended in place of answering."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self.process.args} ended with {self.process.wait()}")
        return dict(json.loads(line))


@contextmanager
def side(command: list[str], rows: Path) -> Iterator[Side]:
    """A side on one thread of linear algebra, started and ready."""
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with child([*command, str(rows)], env={**os.environ, **ONE_THREAD}, **pipes) as process:
        ready = Side(process)
        assert ready.heard() == {"ready": True}
        yield ready  # leaving closes its input, at which it ends


@dataclass(frozen=True)
class Race:
    """What both said, round by round."""

    ours: list[dict[str, float]]
    theirs: list[dict[str, float]]

    @property
    def ratio(self) -> float:
        """How many times as long theirs takes, by the medians."""
        return median(self.theirs, "seconds") / median(self.ours, "seconds")


def median(answers: list[dict[str, float]], figure: str) -> float:
    """The median of one figure."""
    return statistics.median(each[figure] for each in answers)


def race(ours: Side, theirs: Side, rounds: int, *, near: float | None = None) -> Race:
    """Both in turn, `rounds` times; with `near`, theirs may end (`reach`) at a residual `near` times ours."""
    found = Race([], [])
    for _ in range(rounds):
        found.ours.append(ours.work())
        found.theirs.append(theirs.work(**({} if near is None else {"reach": near * found.ours[-1]["residual"]})))
    return found


def in_turn(ours: Callable[[], float], theirs: Callable[[], float], rounds: int) -> tuple[float, float]:
    """Medians of what two functions of this process return, called in turn."""
    pairs = [(ours(), theirs()) for _ in range(rounds)]
    return statistics.median(pair[0] for pair in pairs), statistics.median(pair[1] for pair in pairs)
