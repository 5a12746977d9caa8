"""Compensation methods on the heavy-robot cell: 80 held-out targets, measured before and after each method.

    uv run python tests/studies/compensation_methods.py [--seeds 3] [--methods NAME …] [--processes 2] [--keep FOLDER]

For each seed one calibration from the 160 poses of the paper on kriging in configuration space; then
`compensate_and_verify` on the same simulated robot with each method, iterated and, where it iterates, by one pass as
published. The simulated world tells the floor: the errors of a predictor that knows the true robot and the constant
errors of the instrument, on the same noisy points. Prints a Markdown table. A study and no test: it judges nothing, but
marks what misses the demands. Runs that are in FOLDER are not done again.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from verified_targets import HEAVY_CELL, MOST_MM, OVER_FLOOR, Verified, calibrated, verified

from cellctl.compensation import METHODS
from cellctl.kinematics import Floats

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
    """Mean / RMS / max of lengths, mm."""
    return f"{errors.mean():.3f} / {np.sqrt(np.mean(errors**2)):.3f} / {errors.max():.3f}"


def cases(seeds: int, methods: list[str]) -> Iterator[Case]:
    """Every method of every seed, iterated, then by one pass."""
    for seed in range(1, seeds + 1):
        yield from (Case(seed, method, 0) for method in methods)
        yield from (Case(seed, method, 1) for method in methods if not METHODS[method].write_back)


def pooled(found: Mapping[Case, Verified]) -> dict[Case, Verified]:
    """All seeds of each method together: one run's ratio is uncertain by 7 %."""
    every: dict[Case, list[Verified]] = {}
    for case, one in found.items():
        every.setdefault(replace(case, seed="all"), []).append(one)
    return {case: Verified.pooled(parts) for case, parts in every.items() if len(parts) > 1}


def main() -> int:
    """Run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS))
    parser.add_argument("--processes", type=int, default=1, help="runs at once")
    parser.add_argument("--keep", type=Path, help="folder for the run folders")
    asked = parser.parse_args()
    folder = asked.keep or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(asked.processes) as pool:
        models = dict(enumerate(pool.map(lambda seed: calibrated(seed, folder), range(1, asked.seeds + 1)), 1))
        tried = list(cases(asked.seeds, asked.methods))
        runs = pool.map(lambda of: verified(int(of.seed), models[int(of.seed)], folder, of.method, of.passes), tried)
        print(HEAD, flush=True)
        found = {}
        for case, run in zip(tried, runs, strict=True):
            found[case] = Verified.of(run, HEAVY_CELL, int(case.seed))
            print(case.row(found[case]), flush=True)
    for case, both in pooled(found).items():
        print(case.row(both))
    return 0


if __name__ == "__main__":
    sys.exit(main())
