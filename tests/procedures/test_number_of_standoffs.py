"""The number of stand-offs that a user is told to measure is the number that the verdict needs."""

from __future__ import annotations

import re

import numpy as np
import pytest

from cellctl.calibration import paired_verdict
from tests.helpers.runs import ROOT

DOCUMENT = (ROOT / "docs" / "measuring.md").read_text(encoding="utf-8")
TABLE = DOCUMENT.partition("<!-- stand-off power")[2].partition("<!-- end of stand-off power -->")[0]
LINES = [tuple(map(int, found)) for found in re.findall(r"\| (\d+) \| (\d+) % \| (\d+) % \|", TABLE)]
DRAWS = 400


def share_better(targets: int, left: float) -> float:
    """Percentage of campaigns that end `better` if a table leaves this share of normally distributed errors."""
    before, after = np.abs(np.random.default_rng(targets).normal(size=(2, DRAWS, targets)))
    verdicts = [paired_verdict(*pair) for pair in zip(before, left * after, strict=True)]
    return 100.0 * verdicts.count("better") / DRAWS


@pytest.mark.parametrize(("targets", "perfect", "quarter"), LINES)
def test_the_documented_share_of_runs_that_prove_a_gain_is_that_of_the_verdict(
    targets: int, perfect: int, quarter: int
) -> None:
    three_sigma = 300.0 * 0.5 / np.sqrt(DRAWS)
    assert share_better(targets, 0.0) == pytest.approx(perfect, abs=three_sigma)
    assert share_better(targets, 0.25) == pytest.approx(quarter, abs=three_sigma)


def test_the_document_has_the_default_number() -> None:
    assert 30 in [targets for targets, *_ in LINES]
