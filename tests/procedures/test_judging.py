"""The verdict of a campaign with a proof, and a table that did no good."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.devices import TableInfo, TableState
from cellctl.records import TableStateRow
from procedures.steps.sphere._identification import verdict_of
from procedures.steps.sphere.rows import SphereVerdict, StandOffRow
from procedures.steps.table_push import take_back_unhelpful
from tests.helpers.steps import HELD_OUT_SENTENCE, Context, sphere_verdict, standoff

HELD_OUT = sphere_verdict()
MINE = TableStateRow("mine", 2, True, True, True, 0.1)


def standoffs(before: list[float], after: list[float], sigma: float = 0.03) -> list[StandOffRow]:
    return [
        standoff(number=n, run=run, sphere="P1", error_mm=e, expected_mm=x, sigma_mm=sigma)
        for run, errors, x in (("after", after, 0.0), ("before", before, 0.5))
        for n, e in reversed(list(enumerate(errors)))
    ]


def judged(before: list[float], after: list[float]) -> SphereVerdict:
    context: Any = Context([HELD_OUT, *standoffs(before, after), MINE])
    return verdict_of(context)


def test_without_stand_offs_the_verdict_is_that_of_the_held_out_touches() -> None:
    context: Any = Context([HELD_OUT])
    assert verdict_of(context) == HELD_OUT


def test_stand_off_figures_are_of_absolute_errors_and_lead_the_verdict() -> None:
    found = judged([1.0, -1.0, 2.0, -2.0], [0.03, -0.03, 0.01, -0.05])
    assert found.verdict == "better"
    assert found.before is not None
    assert found.after is not None
    assert found.held_out is not None
    assert found.standoff is not None
    assert (found.before.mean, found.before.max) == (1.5, 2.0)
    assert found.before.rms == pytest.approx(np.sqrt(2.5))
    assert found.after.mean == pytest.approx(0.03)
    assert found.after.max == pytest.approx(0.05)
    assert found.held_out.after == HELD_OUT.after
    assert found.model == HELD_OUT.model
    assert found.standoff.n == 4
    assert found.standoff.predicted_sigma == pytest.approx(0.03)
    assert found.standoff.found_sigma == pytest.approx(np.sqrt((9 + 9 + 1 + 25) / 4) * 0.01)
    assert found.table == MINE


def test_the_sentence_states_the_stand_off_error_and_the_next_line_the_held_out_touches() -> None:
    found = judged([1.0, -1.0, 2.0, -2.0], [0.03, -0.03, 0.01, -0.05])
    assert found.sentence == (
        "Stand-off error at sphere P1 (not used for calibration): 1.500 mm before, 0.030 mm after "
        "(mean of 4; max 2.000, 0.050 mm). Better than nominal."
    )
    assert found.lines[0] == HELD_OUT_SENTENCE


def test_pairs_are_compared_target_by_target() -> None:
    errors = list(np.linspace(0.1, 5.0, 12))
    assert judged(errors, [error - 0.05 for error in errors]).verdict == "better"
    assert judged(errors, list(reversed(errors))).verdict == "no better"


def test_stand_offs_that_are_worse_make_the_verdict_worse() -> None:
    found = judged([0.10, 0.11, 0.09, 0.10], [0.50, 0.52, 0.49, 0.51])
    assert found.verdict == "worse"
    assert "Worse than nominal: the table was rolled back." in found.sentence


FEW = ([2.05, 0.97, -2.86, 0.64, 0.07, -0.52], [0.14, 0.25, 0.05, 0.47, -0.38, 0.77])
"""Stand-offs of a simulated robot, mm: six are too few for this gain, though it is real."""


def test_an_unproved_gain_states_how_many_targets_prove_it() -> None:
    found = judged(*FEW)
    assert found.sentence == (
        "Stand-off error at sphere P1 (not used for calibration): 1.185 mm before, 0.343 mm after (mean of 6; "
        "max 2.860, 0.770 mm). No better than nominal, the difference is within its own scatter: the table was rolled "
        "back. A gain of this size and scatter needs at least 12 targets: measure more."
    )
    assert judged(*(2 * errors for errors in FEW)).verdict == "better"


def test_where_there_is_no_gain_no_number_of_targets_is_stated() -> None:
    found = judged(list(reversed(FEW[1])), FEW[0])
    assert found.verdict == "no better"
    assert found.sentence.endswith(
        "No better than nominal, the difference is within its own scatter: the table was rolled back."
    )


class Tables:
    """A controller's tables, by id: active and previous."""

    def __init__(self, active: str | None, previous: str | None) -> None:
        self.active, self.previous = active, previous

    async def table_state(self) -> TableState:
        infos = [TableInfo(name, 1, "") if name else None for name in (self.active, self.previous)]
        return TableState(infos[0], infos[1], None)

    async def rollback_table(self) -> TableState:
        self.active, self.previous = self.previous, self.active
        return await self.table_state()


@pytest.mark.parametrize("previous", ["old", None])
def test_a_table_that_did_no_good_is_taken_back_and_said_to_be(previous: str | None, tmp_path: Path) -> None:
    context: Any = Context([MINE], tmp_path / "run")
    robot: Any = Tables("mine", previous)
    row = asyncio.run(take_back_unhelpful(context, robot))
    assert robot.active == previous
    assert row.active is False
    assert row.pushed
    assert context.recorded(TableStateRow)[-1] == row
    assert "no longer in force" in context.said[0]


def test_a_table_that_is_not_in_force_any_more_is_not_rolled_back_again(tmp_path: Path) -> None:
    context: Any = Context([MINE], tmp_path / "run")
    robot: Any = Tables("old", "mine")
    asyncio.run(take_back_unhelpful(context, robot))
    assert robot.active == "old"
