"""Compensation methods on the heavy-robot cell: 80 held-out targets, measured before and after each method.

For each seed one calibration from the 160 poses of the paper on kriging in configuration space; then
`compensate_and_verify` on the same simulated robot with each method, iterated and, where it iterates, by one pass as
published. The simulated world tells the floor: the errors of a predictor that knows the true robot and the constant
errors of the instrument, on the same noisy points. Prints a Markdown table. A study and no test: it judges nothing, but
marks what misses the demands. Run folders stay in `runs/studies/CODE/compensation_methods`.
"""

from __future__ import annotations

import fcntl
from argparse import Namespace
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cellctl.compensation import METHODS
from cellctl.kinematics import Floats
from tests.helpers.tracker import HEAVY_CELL, MOST_MM, OVER_FLOOR, Verified, calibrated, verified
from tests.studies._runner import ROWS, Row, Study, Table, each

HEAD = (
    "| seed | method | passes | targets | mean / RMS / max before → after, mm | floor, RMS | ratio to the floor (95 %) "
    "| demands |\n|---|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True)
class Case:
    """A method on the robot of a seed; passes 0: until it converges."""

    seed: int | str
    method: str
    passes: int

    def row(self, found: Verified) -> str:
        """Its line of the table."""
        errors = " → ".join(figures(each) for each in (found.before, found.after))
        ratio = found.ratio
        return (
            f"| {self.seed} | {self.method} | {self.passes or 'iterated'} | {len(found.after)} | {errors} "
            f"| {ratio.floor_mm:.3f} | {ratio.ratio:.2f} ({ratio.low:.2f} … {ratio.high:.2f}) | {self.judged(found)} |"
        )

    def judged(self, found: Verified) -> str:
        """Whether an iterated method meets the demands; write-back and one pass have none."""
        if self.passes or METHODS[self.method].write_back:
            return "–"
        misses = [
            *(["max"] if found.after.max() > MOST_MM else []),
            *(["ratio"] if found.ratio.ratio > OVER_FLOOR else []),
        ]
        return f"missed: {', '.join(misses)}" if misses else "met"


def figures(errors: Floats) -> str:
    """Mean/RMS/max of lengths, mm."""
    return f"{errors.mean():.3f}/{np.sqrt(np.mean(errors**2)):.3f}/{errors.max():.3f}"


def units(asked: Namespace) -> Iterator[Row]:
    """Every method of every seed, iterated, then by one pass; seeds side by side, as each begins with a calibration."""
    for unit in each(passes=(0, 1), method=asked.methods, seed=asked.seeds):
        if not (unit["passes"] and METHODS[unit["method"]].write_back):
            yield unit


def measure(seed: int, method: str, passes: int) -> Mapping[str, object]:
    """The errors of the targets; the calibration of a seed is done once."""
    folder = ROWS.resolve() / "compensation_methods"
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"calibrated-{seed}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        model = calibrated(seed, folder)
    return vars(Verified.of(verified(seed, model, folder, method, passes), HEAVY_CELL, seed))


def pooled(found: Mapping[Case, Verified]) -> dict[Case, Verified]:
    """All seeds of each method together: one run's ratio is uncertain by 7 %."""
    every: dict[Case, list[Verified]] = {}
    for case, one in found.items():
        every.setdefault(replace(case, seed="all"), []).append(one)
    return {case: Verified.pooled(parts) for case, parts in every.items() if len(parts) > 1}


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """A line for each seed and method, and all seeds of each method together."""
    runs = {}
    for row in sorted(found, key=lambda row: row["seed"]):
        errors = (np.array(row[name]) for name in ("before", "after", "floor"))
        case = Case(row["seed"], row["method"], row["passes"])
        runs[case] = Verified(*errors, row["correction_deg"], row["left_out"])
    yield Table("\n".join([HEAD, *(case.row(one) for case, one in {**runs, **pooled(runs)}.items())]))


NAMES = {"--methods": {"nargs": "+", "choices": list(METHODS), "default": list(METHODS)}}
STUDY = Study(units, measure, tables, seeds=3, options=NAMES)
