"""The papers' statements over several simulated robots, and the page that shows them (docs/papers.md).

The repository keeps the numbers in tests/studies/kept/papers.jsonl: --write replaces those of the papers that it
writes, --kept makes the tables from them. A study and no test.
"""

from argparse import Namespace
from collections.abc import Iterator
from importlib import import_module

from tests.studies._runner import Row, Study, Table, each
from tests.studies.papers.statements import Paper, Results, page_of

COMPUTED = {
    "sph": "spherical_constraint",
    "cmp": "compensation_methods",
    "krg": "kriging",
    "ann": "point_selection",
}
"""Tag of a paper → the module here that has its `PAPER`."""

TAGS = [*COMPUTED, *(f"{tag}-run" for tag in COMPUTED)]
"""Each paper by computation, and its campaign over the wires (`over_the_wires`)."""

SIGNIFICANT = 6


def paper_of(tag: str) -> Paper:
    """The study of a paper."""
    if tag in COMPUTED:
        return import_module(f"tests.studies.papers.{COMPUTED[tag]}").PAPER
    return import_module("tests.studies.papers.over_the_wires").PAPERS[tag]


def measure(paper: str, seed: int) -> Row:
    """The numbers of one robot, to six digits."""
    numbers = sorted(paper_of(paper).study(seed).items())
    return {"numbers": {key: float(f"{number:.{SIGNIFICANT}g}") for key, number in numbers}}


def tables(found: list[Row], asked: Namespace) -> Iterator[Table]:
    """All tables of each paper."""
    for tag in asked.papers:
        if (results := Results.of(found, tag)).by_seed:
            yield Table(page_of(paper_of(tag), results), f"figures of {tag}", paper_of(tag).title)


OPTIONS = {"--papers": {"nargs": "+", "choices": TAGS, "default": TAGS}}
STUDY = Study(
    lambda asked: each(paper=asked.papers, seed=asked.seeds), measure, tables, seeds=10, options=OPTIONS, writes=True
)
