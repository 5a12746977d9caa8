"""The papers' statements over several simulated robots, and the page that shows them.

    uv run python tests/studies/papers/run.py [--papers TAG …] [--seeds 10] [--jobs 2] [--write docs/papers.md]

Computes the numbers of every seed, keeps them in tests/studies/papers/results/ and prints the tables. With --kept it
computes nothing and takes the kept numbers; with --write it puts the tables into the page. A study and no test.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "helpers"))

from page import page_of, write_into
from statements import Numbers, Paper, Results

HERE = Path(__file__).parent

MODULES = {
    "sph": "spherical_constraint",
    "cmp": "compensation_methods",
    "krg": "kriging",
    "ann": "point_selection",
}
"""Tag of a paper → the module here that has its `PAPER`."""


def paper_of(tag: str) -> Paper:
    """The study of a paper."""
    found: Paper = import_module(MODULES[tag]).PAPER
    return found


def kept(tag: str) -> Path:
    """The file of a paper's numbers."""
    return HERE / "results" / f"{tag}.json"


def computed(tag: str, seeds: int, jobs: int) -> Results:
    """The numbers of seeds 1 … `seeds`, `jobs` of them at a time."""
    numbers = range(1, seeds + 1)
    if jobs == 1:
        return Results({seed: _numbers(tag, seed) for seed in numbers})
    with ProcessPoolExecutor(jobs) as pool:
        return Results(dict(zip(numbers, pool.map(_numbers, [tag] * seeds, numbers), strict=True)))


def _numbers(tag: str, seed: int) -> Numbers:
    found = paper_of(tag).study(seed)
    print(f"{tag}: seed {seed}", file=sys.stderr, flush=True)
    return found


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--papers", nargs="+", choices=MODULES, default=list(MODULES))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--kept", action="store_true", help="compute nothing")
    parser.add_argument("--write", type=Path, help="page whose figures are replaced")
    asked = parser.parse_args()
    for tag in asked.papers:
        if not asked.kept:
            computed(tag, asked.seeds, asked.jobs).save(kept(tag))
        paper = paper_of(tag)
        text = page_of(paper, Results.load(kept(tag)))
        print(f"## {paper.title}\n\n{text}\n")
        if asked.write:
            write_into(asked.write, paper, text)


if __name__ == "__main__":
    main()
