"""The part of the shared memory about on-line corrections: the model's arrays, and what the process reports of it.

As in `SharedBlock`, each slot is written by one side. A model is written into the half that is not in use, and its
version last; the process takes it where version, count and check sum agree.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import final

from drivers.kuka_rsi.axes import AXES
from drivers.kuka_rsi.cyclic.model_arrays import MOST_VALUES

TIMING_STEP_NS = 10_000
TIMING_BINS = 64
"""Durations of the model's part of a cycle, counted in steps of 10 µs; the last bin holds all longer ones."""

_LOG_ROWS = 4096
"""Samples of the log, over an hour at one a second."""

_LOG_SLOTS = 2 + 2 * AXES
_MODEL_SLOTS = 3 + MOST_VALUES


class OnlineSlot(IntEnum):
    """Places of the slots, from the part's first. Up to `VERSION` the engine writes, the halves too.

    `ORDER`: number of the order that is an on-line correction; `RAMP_OUT`: number of the order whose correction is to
    fade to zero; `VERSION`: of the newest model. `TAKEN`, `REFUSED`: versions of the model in use, and of the last that
    was refused; `CYCLES`: corrected; `LIMITED`, `OUTSIDE`: of these, cut by a limit, outside the measured region;
    `INSIDE`: share by which the correction is faded; `CORRECTION`, `PROGRAMMED`: last one sent, deg, and its joints;
    `LOGGED`: samples in the log so far.
    """

    ORDER = 0
    RAMP_OUT = 1
    VERSION = 2
    TAKEN = 3
    REFUSED = 4
    CYCLES = 5
    LIMITED = 6
    OUTSIDE = 7
    INSIDE = 8
    CORRECTION = 9
    PROGRAMMED = CORRECTION + AXES
    TIMING = PROGRAMMED + AXES
    LOGGED = TIMING + TIMING_BINS
    LOG = LOGGED + 1
    HALVES = LOG + _LOG_ROWS * _LOG_SLOTS


ONLINE_SLOTS = OnlineSlot.HALVES + 2 * _MODEL_SLOTS


@final
@dataclass(frozen=True, slots=True)
class LogRow:
    """A sample of the log: arrival of the telegram, ns of the cell's time; the rest as the slots of these names."""

    arrival_ns: int
    programmed: tuple[float, ...]
    correction: tuple[float, ...]
    inside: float


@final
@dataclass(frozen=True, slots=True)
class OnlineStatus:
    """What the process reports; counts since its start. Fields as the slots of the same names."""

    taken: int
    refused: int
    cycles: int
    limited: int
    outside: int
    inside: float
    correction: tuple[float, ...]
    programmed: tuple[float, ...]


@final
class OnlineBlock:
    """A view of that part: the same slots as whole numbers and as reals."""

    def __init__(self, words: memoryview[int], reals: memoryview[float]) -> None:
        self.words = words
        self.reals = reals

    # the engine's side

    def place_model(self, values: Sequence[float]) -> int:
        """Write a model as `pack` made it; returns its version, from 1."""
        version = self.words[OnlineSlot.VERSION] + 1
        start = _half(version)
        for place, value in enumerate(values, start + 3):
            self.reals[place] = value
        self.words[start] = version
        self.words[start + 1] = len(values)
        self.words[start + 2] = _check_sum(version, values)
        self.words[OnlineSlot.VERSION] = version
        return version

    def status(self) -> OnlineStatus:
        """The last state that the process published."""
        words, reals = self.words, self.reals
        taken, refused, cycles, limited, outside = words[OnlineSlot.TAKEN : OnlineSlot.INSIDE]
        axes = [tuple(reals[slot : slot + AXES]) for slot in (OnlineSlot.CORRECTION, OnlineSlot.PROGRAMMED)]
        return OnlineStatus(taken, refused, cycles, limited, outside, reals[OnlineSlot.INSIDE], *axes)

    def log(self, tail: int, until_ns: int) -> tuple[list[LogRow], int]:
        """Rows from count `tail` on that arrived up to `until_ns` and are still there; the count to continue from."""
        head = self.words[OnlineSlot.LOGGED]
        rows: list[LogRow] = []
        for count in range(max(tail, head - _LOG_ROWS + 1), head):
            row = self._log_row(count)
            if row.arrival_ns > until_ns:
                return rows, count
            rows.append(row)
        return rows, head

    def _log_row(self, count: int) -> LogRow:
        start = _log_place(count)
        programmed, correction = (tuple(self.reals[at : at + AXES]) for at in (start + 2, start + 2 + AXES))
        return LogRow(self.words[start], programmed, correction, self.reals[start + 1])

    def timing(self) -> tuple[int, ...]:
        """How many cycles lasted so many steps of 10 µs in the model's part."""
        return tuple(self.words[OnlineSlot.TIMING : OnlineSlot.TIMING + TIMING_BINS])

    # the cyclic process's side

    def read_model(self, version: int) -> list[float]:
        """The arrays of model `version`. Raises ValueError where it is not there complete."""
        start = _half(version)
        found, count, check_sum = self.words[start : start + 3]
        values = list(self.reals[start + 3 : start + 3 + count]) if 0 < count <= MOST_VALUES else []
        if found != version or check_sum != _check_sum(version, values):
            raise ValueError(f"model {version} is incomplete")
        return values

    def publish(self, correction: Sequence[float], programmed: Sequence[float], inside: float) -> None:
        """The correction of a cycle."""
        for slot, values in ((OnlineSlot.CORRECTION, correction), (OnlineSlot.PROGRAMMED, programmed)):
            for place, value in enumerate(values, slot):
                self.reals[place] = value
        self.reals[OnlineSlot.INSIDE] = inside

    def count(self, inside: float, limited: bool) -> None:
        """A cycle was corrected by the model."""
        self.words[OnlineSlot.CYCLES] += 1
        self.words[OnlineSlot.LIMITED] += limited
        self.words[OnlineSlot.OUTSIDE] += inside < 1.0

    def add_log_row(self, row: LogRow) -> None:
        """Write a row over the oldest."""
        count = self.words[OnlineSlot.LOGGED]
        start = _log_place(count)
        self.words[start], self.reals[start + 1] = row.arrival_ns, row.inside
        for place, value in enumerate((*row.programmed, *row.correction), start + 2):
            self.reals[place] = value
        self.words[OnlineSlot.LOGGED] = count + 1

    def lasted(self, ns: int) -> None:
        """The model's part of a cycle took so long."""
        self.words[OnlineSlot.TIMING + min(ns // TIMING_STEP_NS, TIMING_BINS - 1)] += 1


def _log_place(count: int) -> int:
    return OnlineSlot.LOG + (count % _LOG_ROWS) * _LOG_SLOTS


def _half(version: int) -> int:
    return OnlineSlot.HALVES + (version % 2) * _MODEL_SLOTS


def _check_sum(version: int, values: Sequence[float]) -> int:
    return zlib.crc32(struct.pack(f"=qq{len(values)}d", version, len(values), *values))
