"""The folds of a fit in processes of their own: `cellctl.operations.worker` makes the rows again and fits each fold.

JSON carries every number exactly, and each process has one thread for linear algebra, so that the result is that of
one process, byte for byte. Nothing is lost by a process that fails: its folds are computed here.
"""

from __future__ import annotations

import json
import os
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from typing import Any, final

import numpy as np

from cellctl.calibration import HeldOut, Split
from cellctl.calibration.identification.progress import Progress
from cellctl.calibration.problem.task import Task
from cellctl.calibration.verdict.fit import held_out_fold
from cellctl.operations.pace import Pace
from cellctl.operations.worker import WORKER

WORTH_S = 6.0
"""Processor time, s, that all folds have to take before other processes do some: each takes 1 to 2 s to begin."""

ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "MKL", "OMP")}


def as_lists(found: HeldOut) -> dict[str, Any]:
    """Held-out rows as JSON; `held_out_of` is its inverse."""
    values = {each.name: getattr(found, each.name) for each in fields(found)}
    return {name: None if value is None else np.asarray(value).tolist() for name, value in values.items()}


def held_out_of(lists: Mapping[str, Any]) -> HeldOut:
    """Held-out rows from their JSON."""
    kinds = {name: int if name == "posture" else float for name in lists}
    found: dict[str, Any] = {}
    for name, value in lists.items():
        found[name] = None if value is None else np.array(value, kinds[name])
    return HeldOut(**found)


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@final
class FoldProcesses:
    """Computes the folds of a fit in at most `processes` processes, this one included.

    None: as many as there are processors, where the folds take more than `WORTH_S`. request: from which the worker
    makes the same rows. progress: is told the share of the whole fit's time.
    """

    def __init__(
        self, task: Task, split: Split, request: Mapping[str, Any], processes: int | None, progress: Progress
    ) -> None:
        self._task, self._split, self._request, self._processes = task, split, request, processes
        self._folds = split.folds_apart
        self._pace = Pace(progress, len(self._folds), self._rounds, time.monotonic)
        self._began = time.thread_time()
        self.model = self._pace.part(0)
        """The progress of the model's own identification."""

    def __call__(self, numbers: Sequence[int]) -> list[HeldOut]:
        """The held-out rows of these parts of the split, each predicted by a model of its other rows."""
        self._pace.ended(0)
        count = self._count(time.thread_time() - self._began)
        lanes = [numbers[place::count] for place in range(count)]
        self._pace.lanes = [[self._part(number) for number in lane] for lane in lanes]
        others = [_Process(self, lane) for lane in lanes[1:]]
        try:
            found = {number: self._computed(number) for number in lanes[0]}
            for each in others:
                found |= each.results()
        finally:
            for each in others:
                each.end()
        return [found[number] if number in found else self._computed(number) for number in numbers]

    def _count(self, seconds: float) -> int:
        """How many processes the folds are worth, if one of them takes so many seconds of a processor."""
        if self._processes is None and seconds * len(self._folds) < WORTH_S:
            return 1
        return max(min(self._processes or processors(), len(self._folds)), 1)

    def _rounds(self, seconds: float) -> int:
        return -(-len(self._folds) // self._count(seconds))

    def _part(self, number: int) -> int:
        return self._folds.index(number) + 1

    def _computed(self, number: int) -> HeldOut:
        found = held_out_fold(self._task, self._split, number, self._pace.part(self._part(number)))
        self._pace.ended(self._part(number))
        return found

    def command(self, lane: Sequence[int]) -> str:
        """The request for some of the folds."""
        return json.dumps({**self._request, "folds": list(lane)})

    def told(self, line: Mapping[str, Any]) -> HeldOut | None:
        """Take a line of a worker: its progress (None), or the rows of a fold that is done."""
        part = self._part(line["fold"])
        if "held_out" not in line:
            self._pace.part(part)(line["doing"], line["share"])
            return None
        self._pace.ended(part)
        return held_out_of(line["held_out"])


@final
class _Process:
    """A worker that computes some folds, and the thread that reads what it tells."""

    def __init__(self, owner: FoldProcesses, lane: Sequence[int]) -> None:
        self._owner, self._found = owner, dict[int, HeldOut]()
        self._process = subprocess.Popen(
            [*WORKER, "folds"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **ONE_THREAD},
            text=True,
        )
        self._reader = threading.Thread(target=self._follow, args=(owner.command(lane),), daemon=True)
        self._reader.start()

    def results(self) -> dict[int, HeldOut]:
        """Fold → its rows, once the process has ended; without those that it did not compute."""
        self._reader.join()
        return self._found

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()
        self._process.wait()
        self._reader.join()

    def _follow(self, request: str) -> None:
        assert self._process.stdin
        assert self._process.stdout
        with suppress(OSError, ValueError):  # it was ended, or a line was cut
            with self._process.stdin as target:
                target.write(request)
            for text in self._process.stdout:
                line = json.loads(text)
                if "fold" in line and (rows := self._owner.told(line)) is not None:
                    self._found[line["fold"]] = rows
        self._process.stdout.close()
