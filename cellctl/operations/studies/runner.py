"""Units of work and their rows: each is computed once, and appended to a file as soon as it is done.

A unit is a mapping of arguments; its row has these and what was measured. A later call computes only the units whose
row is not in the file. What computes them (`Compute`) may repeat a unit or change their order; no row is there twice.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeAlias

from threadpoolctl import threadpool_limits

Row: TypeAlias = dict[str, Any]
Measure: TypeAlias = Callable[..., Mapping[str, Any]]
"""A function of a module: takes a unit's values by their names."""
Work: TypeAlias = Callable[[Row], str]
"""Takes a unit, gives its row as a line of JSON; can be pickled."""
Compute: TypeAlias = Callable[[Work, Sequence[Row]], Iterator[tuple[Row, str]]]
"""Computes units in any order: each with its line."""
Told: TypeAlias = Callable[[Row, int, int, float], None]
"""Takes the unit that is done, how many are, of how many in this call, and the seconds so far."""

ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "MKL", "OMP")}


def each(**axes: Iterable[Any]) -> Iterator[Row]:
    """A unit for each combination; the last axis changes first."""
    return (dict(zip(axes, values, strict=True)) for values in product(*axes.values()))


def as_line(row: Mapping[str, Any]) -> str:
    """A row as a line of JSON; arrays are lists."""
    return json.dumps(row, default=lambda array: array.tolist(), ensure_ascii=False) + "\n"


def line_of(measure: Measure, more: Mapping[str, Any], unit: Row) -> str:
    """The row of a unit, with what is the same in all rows; one thread for linear algebra."""
    threadpool_limits(1)  # not as a context: the thread beside may still compute when this one ends
    return as_line({**unit, **measure(**unit), **more})


def load(file: Path) -> list[Row]:
    """The rows of a file; a last line that was cut off when a call was killed is taken away."""
    whole, end, cut = file.read_text(encoding="utf-8").rpartition("\n") if file.exists() else ("", "", "")
    if cut:
        file.write_text(whole + end, encoding="utf-8")
    return [json.loads(line) for line in whole.split("\n") if line]


def of_unit(unit: Row, rows: Iterable[Row]) -> Row | None:
    """The row of a unit."""
    return next((row for row in rows if unit.items() <= row.items()), None)


def computed(
    measure: Measure, units: Sequence[Row], file: Path, compute: Compute, told: Told, more: Mapping[str, Any]
) -> list[Row]:
    """The rows of these units, which differ, appended to the file as they come."""
    file.parent.mkdir(parents=True, exist_ok=True)
    waiting, found, began = {as_line(unit) for unit in units}, list[Row](), time.perf_counter()
    with file.open("a", encoding="utf-8") as target:
        for unit, line in compute(partial(line_of, measure, more), units):
            if (key := as_line(unit)) not in waiting:
                continue  # a unit that was begun again, and whose first computation came back after all
            waiting.remove(key)
            target.write(line)
            target.flush()
            os.fsync(target.fileno())
            found.append(json.loads(line))
            told(unit, len(found), len(units), time.perf_counter() - began)
    return found


def in_processes(count: int) -> Compute:
    """Computes in `count` processes of this computer."""

    def compute(work: Work, units: Sequence[Row]) -> Iterator[tuple[Row, str]]:
        os.environ.update(ONE_THREAD)  # the workers import NumPy with this
        waiting, running = [*reversed(units)], dict[Future[str], Row]()
        with ProcessPoolExecutor(max(min(count, len(units)), 1), get_context("spawn")) as pool:
            while waiting or running:
                while waiting and len(running) < count:  # none is queued, so that none is begun after an error
                    unit = waiting.pop()
                    running[pool.submit(work, unit)] = unit
                for done in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(done), done.result()

    return compute
