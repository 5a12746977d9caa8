"""The part of the shared memory about on-line corrections: the model's arrays in their order, and what is reported.

The engine derives them from an identified robot; the process turns them into corrections. See `CorrectionModel` of
`cellctl.devices` for the meaning of each.

As in `SharedBlock`, each slot is written by one side. A model is written into the half that is not in use, and its
version last; the process takes it where version, count and check sum agree.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import final

from drivers.kuka_rsi import AXES

FORMAT = 1
"""Of the arrays' names, sizes and order; both sides are of one installation, so that another one is an error."""

MOST_VALUES = 16_384
"""Numbers of a model; 288 waves (6 joints with 48) and 448 nodes (64 centres of a discrepancy, 3 · 128 of a field) need
8200."""

_LARGEST = 1e9
"""Of any number: bounds the arithmetic of the compiled step, which checks nothing."""

_LONGEST_MM = 1e5
"""Of a step between frames, 100 m: with longer ones the Newton step loses its digits."""

_HIGHEST_ORDER = 1000
"""Of a wave, per turn of its joint: bounds the loop of the compiled step."""

_ROUNDING = 1e-6
"""Of the elements of a rotation matrix: far above the rounding of frames, far below a wrong one."""

_HEAD = 3
"""Format, waves, nodes: in front of the arrays."""


def sizes(waves: int, nodes: int) -> dict[str, int]:
    """Count of numbers of each array, by its name, in the order in memory."""
    return {
        "sign": AXES,
        "offset": AXES,
        "base": 16,
        "links": 16 * (AXES + 1),
        "tool": 16,
        "identified": 16 * (AXES + 1),
        "identified_base": 9,
        "down": 3,
        "weight": 2 * AXES * AXES,
        "load": AXES,
        "load_place": 3,
        "bend": 1,
        "stretch": AXES + 1,
        "wave_joint": waves,
        "wave_order": waves,
        "wave_sine": waves,
        "wave_cosine": waves,
        "node_place": AXES * nodes,
        "node_scale": AXES * nodes,
        "node_weight": 3 * nodes,
        "lower": AXES,
        "upper": AXES,
        "fade": 1,
    }


def pack(arrays: Mapping[str, Sequence[float]]) -> tuple[float, ...]:
    """The numbers of a model in the order in memory. Raises ValueError for arrays that are not those of a model."""
    waves, nodes = len(arrays.get("wave_joint", ())), len(arrays.get("node_weight", ())) // 3
    expected, given = sizes(waves, nodes), {name: len(values) for name, values in arrays.items()}
    if given != expected:
        wrong = sorted(name for name in given.keys() | expected.keys() if given.get(name) != expected.get(name))
        raise ValueError(f"a correction model for {AXES} axes has other arrays: {', '.join(wrong)}")
    values = (float(FORMAT), float(waves), float(nodes), *(float(v) for name in expected for v in arrays[name]))
    unpack(values)
    return values


def unpack(values: Sequence[float]) -> dict[str, Sequence[float]]:
    """The arrays in `values`, by name. Raises ValueError where `pack` did not make them, or they are no robot's."""
    if len(values) > MOST_VALUES:
        raise ValueError(f"a correction model of {len(values)} numbers (at most {MOST_VALUES})")
    if not all(map(math.isfinite, values)) or max(map(abs, values), default=0.0) > _LARGEST:
        raise ValueError("a correction model with a number that is not finite or beyond all measure")
    if len(values) < _HEAD or values[0] != FORMAT or not _whole(values[1:_HEAD], 0, MOST_VALUES):
        raise ValueError("no correction model of this format")
    found, start = {}, _HEAD
    for name, size in sizes(int(values[1]), int(values[2])).items():
        found[name] = values[start : start + size]
        start += size
    if start != len(values):
        raise ValueError(f"a correction model of {start} numbers has {len(values)}")
    if wrong := _impossible(found):
        raise ValueError(f"a correction model with an impossible {wrong}")
    return found


def _impossible(arrays: Mapping[str, Sequence[float]]) -> str:
    """The first array that is no robot's, in words; empty without one. The compiled step relies on them."""
    for name in ("base", "links", "tool", "identified"):
        frames = arrays[name]
        if not all(_is_frame(frames[at : at + 16]) for at in range(0, len(frames), 16)):
            return f"{name} (a frame is a rotation and at most {_LONGEST_MM:g} mm)"
    if not _is_rotation(arrays["identified_base"]):
        return "identified_base (no rotation)"
    if not all(abs(sign) == 1 for sign in arrays["sign"]):
        return "sign (1 or -1)"
    if not _whole(arrays["wave_joint"], 0, AXES - 1):
        return f"wave_joint (0 to {AXES - 1})"
    if not _whole(arrays["wave_order"], 1, _HIGHEST_ORDER):
        return f"wave_order (1 to {_HIGHEST_ORDER})"
    if not all(low <= high for low, high in zip(arrays["lower"], arrays["upper"], strict=True)):
        return "region (lower above upper)"
    return "" if arrays["fade"][0] > 0 else "fade (not positive)"


def _whole(values: Sequence[float], least: int, most: int) -> bool:
    return all(least <= value <= most and value == int(value) for value in values)


def _is_frame(matrix: Sequence[float]) -> bool:
    """Of 16 numbers, row by row."""
    turn = [matrix[at + k] for at in (0, 4, 8) for k in range(3)]
    near = max(abs(matrix[at]) for at in (3, 7, 11)) <= _LONGEST_MM
    return near and tuple(matrix[12:]) == (0, 0, 0, 1) and _is_rotation(turn)


def _is_rotation(matrix: Sequence[float]) -> bool:
    """Of 9 numbers, row by row: each row is the cross product of the other two, and the first is a unit."""
    x, y, z = matrix[:3], matrix[3:6], matrix[6:]
    made = (*_cross(y, z), *_cross(z, x), *_cross(x, y))
    unit = abs(math.hypot(*x) - 1) <= _ROUNDING
    return unit and all(abs(a - b) <= _ROUNDING for a, b in zip(matrix, made, strict=True))


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


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
