"""Campaigns in batches: what ends them, that held-out touches take no part in it, and when the goal counts as met."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cellctl.formats import ModelFile
from cellctl.records import ENDED, BatchRow
from procedures.steps.goal import goal_figures, goal_of, unmet, with_goal
from procedures.steps.sphere.plan_inputs import PlanInputs, touches_planned
from procedures.steps.sphere.rows import SphereVerdict, TouchRow
from tests.helpers.steps import VERDICT, Context
from tests.helpers.touch_campaign import SECONDS, SPHERES, TouchCampaign

COMMON: dict[str, Any] = {
    "spheres": ", ".join(SPHERES),
    "reference_every": 20,
    "held_out": 20,
    "goal_mm": 0.001,
    "most": 60,
}
BATCH = BatchRow(
    noun="touches",
    rows=55,
    most=150,
    goal_mm=0.1,
    low_mm=0.03,
    median_mm=0.05,
    high_mm=0.09,
    next_mm=None,
    to_goal=None,
    seconds=600.0,
    model="geometry",
    ended="goal",
)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> tuple[TouchCampaign, Any]:
    """A campaign that has made the touches before its first batch, and their plan."""
    campaign = TouchCampaign(2, tmp_path_factory.mktemp("begun"))
    plan = campaign.do("sphere.plan", fit=18, **COMMON)
    campaign.touch(plan.touches)
    return campaign, plan


@pytest.fixture
def after(begun: tuple[TouchCampaign, Any], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """The next batch of that campaign with these inputs; nothing of it stays."""
    campaign, plan = begun
    monkeypatch.setattr(campaign.context, "rows", list(campaign.context.rows))

    def decide(**inputs: Any) -> tuple[Any, BatchRow]:
        asked = {**COMMON, "batch": 0, "size": 10, "reference": plan.touches[0], **inputs}
        found = campaign.do("sphere.next_batch", **asked)
        return found, campaign.context.recorded(BatchRow)[-1]

    return decide


@pytest.mark.long
def test_the_plan_has_the_first_touches_and_half_of_the_held_out_ones(begun) -> None:
    _, plan = begun
    sets = [touch.set for touch in plan.touches]
    assert (sets.count("fit"), sets.count("test"), plan.batches) == (35, 10, [0, 1, 2, 3])


@pytest.mark.long
def test_a_batch_is_planned_with_its_forecast(after) -> None:
    found, row = after(goal_mm=0.12, most=150)
    assert [touch.set for touch in found.touches].count("fit") == 10
    assert found.touches[-1].set == "reference"
    assert row.rows == 35
    assert not row.ended
    assert row.low_mm < row.median_mm < row.high_mm
    assert row.next_mm is not None
    assert row.next_mm < row.high_mm
    assert row.to_goal is not None
    assert 0 < row.to_goal <= 115
    assert f"about {row.to_goal} more for the goal" in row.sentence
    numbers = [touch.number for touch in found.touches]
    assert numbers == list(range(numbers[0], numbers[0] + 11))


@pytest.mark.parametrize(
    ("inputs", "ended"),
    [
        ({"goal_mm": 5.0}, "goal"),
        ({"most": 35}, "rows"),
        ({"minutes": 10.0}, "time"),
        ({"gain_percent": 99.0}, "gain"),
    ],
)
def test_it_ends_and_states_why(after, begun, inputs: dict[str, Any], ended: str) -> None:
    found, row = after(**inputs)
    assert (found.ended, row.ended) == (ended, ended)
    assert ENDED[ended] in row.sentence
    assert {touch.set for touch in found.touches} == {"test", "reference"}
    again, _ = after(**inputs)
    assert again.touches == []
    assert len(begun[0].context.recorded(BatchRow)) == 1


@pytest.mark.long
def test_held_out_touches_and_pauses_take_no_part_in_the_decision(after, begun) -> None:
    _, row = after()
    rows, last = begun[0].context.rows, begun[0].context.rows[-2].number
    rows.remove(row)
    for place, one in enumerate(rows):
        if isinstance(one, TouchRow) and one.number > 20:
            rows[place] = replace(one, time_ns=one.time_ns + 10**13)
    wrong = np.random.default_rng(1)
    for place, one in enumerate(rows):
        if isinstance(one, TouchRow) and one.set == "test":
            joints = np.floor(one.joints) + 0.5 + wrong.uniform(-0.4, 0.4, 6)
            rows[place] = replace(one, joints=tuple(joints.tolist()))
    again = after()[1]
    assert again.seconds == pytest.approx(SECONDS * (last - 1))
    assert replace(again, seconds=row.seconds) == row


def result(errors: Any, sigma_ok: bool | None = True) -> Any:
    identified = SimpleNamespace(noise=np.ones(1))
    return SimpleNamespace(
        test_errors=np.array(errors),
        n_test=len(errors),
        sigma_ok=sigma_ok,
        sigma_reason="three of ten",
        identification=identified,
    )


def goal(row: BatchRow, found: Any) -> Any:
    return goal_figures(Context(rows=[row]), found, 0.017)  # type: ignore[arg-type]


@pytest.mark.parametrize("sigma_ok", [True, None])
def test_a_goal_is_met_where_held_out_touches_agree(sigma_ok: bool | None) -> None:
    found = goal(BATCH, result(np.full(30, 0.03), sigma_ok))
    assert found.met
    assert with_goal("better", found) == "better"
    assert unmet(found) == ""
    assert "met (predicted below 0.090 mm with 95 % after 55 touches)" in found.sentence


@pytest.mark.parametrize(
    ("row", "found", "why"),
    [
        (BATCH, result(np.full(30, 0.09)), "held-out touches are off by 0.075 mm at least"),
        (BATCH, result(np.full(30, 0.03), sigma_ok=False), "cannot be trusted (three of ten)"),
        (replace(BATCH, ended="gain"), result(np.full(30, 0.03)), "would gain too little"),
        (replace(BATCH, ended="time"), result(np.full(30, 0.03)), "the time is used"),
    ],
)
def test_else_it_is_not_and_the_run_does_not_end_well(row: BatchRow, found: Any, why: str) -> None:
    figures = goal(row, found)
    assert not figures.met
    assert why in figures.sentence
    verdict = SphereVerdict(**VERDICT | {"verdict": with_goal("better", figures), "model": {"goal": vars_of(figures)}})
    assert (verdict.verdict, verdict.better, verdict.passed) == ("not met", True, False)
    assert goal_of(verdict) == figures
    assert with_goal("no better", figures) == "no better"


@pytest.mark.parametrize(("error_mm", "met"), [(0.09, True), (0.15, False)])
def test_a_place_counts_as_one_error_with_a_third_of_its_square_on_each_axis(error_mm: float, met: bool) -> None:
    """30 places: s ≥ e / √3 · √(30 / χ²₃₀(0.95)), with 43.77 for the quantile; allowed: √(0.1² / 3 + 0.017²)."""
    row = replace(BATCH, noun="poses")
    found = goal_figures(Context(rows=[row]), result(np.full(30, error_mm)), 0.017, axes=3)  # type: ignore[arg-type]
    assert found is not None
    assert found.met is met
    if not met:
        at_least = error_mm * np.sqrt(30.0 / 43.77 / 3.0)
        assert f"held-out poses are off by {at_least:.3f} mm at least, and it allows 0.060 mm" in found.why


def vars_of(figures: Any) -> dict[str, Any]:
    return {name: getattr(figures, name) for name in figures.__dataclass_fields__}


def test_without_batches_there_is_no_goal() -> None:
    assert goal_figures(Context(), result([0.03]), 0.017) is None  # type: ignore[arg-type]
    assert goal_of(SphereVerdict(**VERDICT)) is None


def test_plans_with_a_goal_count_the_most_touches_and_refuse_too_few() -> None:
    common = {"held_out": 30, "reference_every": 0}
    assert touches_planned({**common, "fit": 50, "most": 150}) == 80
    assert touches_planned({**common, "fit": 50, "most": 150, "goal_mm": 0.1}) == 180
    with pytest.raises(ValueError, match="30 touches at most are fewer than the first 35"):
        PlanInputs(fit=50, held_out=30, goal_mm=0.1, most=30)


@pytest.mark.long
def test_a_campaign_reaches_its_goal_and_the_robot_is_as_good(tmp_path: Path) -> None:
    asked = {**COMMON, "goal_mm": 0.15, "most": 150}
    campaign = TouchCampaign(3, tmp_path)
    plan = campaign.do("sphere.plan", fit=18, **asked)
    campaign.touch(plan.touches)
    for batch in plan.batches:
        following = campaign.do("sphere.next_batch", batch=batch, size=10, reference=plan.touches[0], **asked)
        campaign.touch(following.touches)
    judged = campaign.do("sphere.identify", goal_mm=0.15)
    curve, context = campaign.context.recorded(BatchRow), campaign.context
    assert curve[-1].ended == "goal"
    assert curve[-1].rows == sum(row.set == "fit" for row in context.recorded(TouchRow)) < 80
    assert sum(row.set == "test" for row in context.recorded(TouchRow)) == 20
    assert judged.verdict == "better"
    assert "Goal of 0.15 mm met" in context.recorded(SphereVerdict)[-1].lines[0]
    model = ModelFile.load(tmp_path / "model.json")
    assert campaign.error(model, campaign.goal_places(model, 20)) < 0.15
