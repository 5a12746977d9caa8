"""docs/papers.md has the tables of the kept numbers, and nothing else between its marks."""

from pathlib import Path

import pytest

from tests.studies._runner import KEPT, load
from tests.studies.papers import TAGS, paper_of
from tests.studies.papers.statements import Results, page_of

PAGE = Path(__file__).parents[2] / "docs" / "papers.md"
ROWS = load(KEPT / "papers.jsonl")


@pytest.mark.parametrize("tag", TAGS)
def test_the_page_is_rendered_from_the_kept_numbers(tag):
    _, _, rest = PAGE.read_text(encoding="utf-8").partition(f"<!-- figures of {tag} -->\n")
    text, _, _ = rest.partition(f"\n<!-- end of figures of {tag} -->")
    assert text == page_of(paper_of(tag), Results.of(ROWS, tag))


@pytest.mark.parametrize("tag", TAGS)
def test_figures_are_of_ten_robots(tag):
    assert sorted(Results.of(ROWS, tag).by_seed) == list(range(1, 11))
