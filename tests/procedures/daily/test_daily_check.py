"""The daily check: baseline, control, a changed robot, runs that cannot be compared, and the false-alarm rate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.engine import State
from cellctl.journal import Journal, Recorded, RunStarted, SourceFile, StateChanged
from cellctl.report import write_report
from procedures.steps.daily._checking import charts
from procedures.steps.daily.rows import (
    ControlChartRow,
    DailyPointsRow,
    DailyVerdict,
    DayPoints,
    EarlierRunsRow,
)
from tests.helpers.steps import PROCEDURES, FakeRun, Faults, Truth, run_fake

PROCEDURE = PROCEDURES / "daily_check.yaml"
NOISE_MM = 0.05


@dataclass(frozen=True)
class Limits:
    baseline_runs: int = 20
    false_alarm: float = 0.0027
    weight: float = 0.2


def earlier_run(folder: Path, number: int, day: DayPoints, *, state: str = "finished") -> None:
    """The journal of an earlier check in `folder`, on day `number`."""
    source, name = SourceFile("x.yaml", "", ""), f"daily_check-{number:02d}"
    with Journal.create(folder / name, lambda: 0) as journal:
        started = RunStarted(
            source, source, {}, 1, "lockstep", "me", f"2026-10-{number:02d}T08:00:00Z", "", {}, name=name,
            section=DailyVerdict.SECTION,
        )  # fmt: skip
        journal.append(started)
        journal.append(Recorded.of(DailyPointsRow(day=day), "", 1))
        journal.append(StateChanged("running", state, ""))


def another_day(day: DayPoints, rng: np.random.Generator, *, elsewhere: bool = False) -> DayPoints:
    """The same robot on another day: new noise of points and nests; elsewhere: the instrument was set up anew."""
    turn = Rotation.from_euler("z", rng.uniform(-20.0, 20.0) * elsewhere, degrees=True).as_matrix()
    shift = rng.uniform(-500.0, 500.0, 3) * elsewhere

    def seen(places: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        found = (np.array(places) + rng.normal(0.0, NOISE_MM, np.shape(places))) @ turn.T + shift
        return tuple(map(tuple, found.tolist()))

    return replace(day, points=seen(day.points), nests=seen(day.nests))


def run_of(folder: Path, truth: Truth | None = None, faults: Faults | None = None) -> FakeRun:
    return run_fake(PROCEDURE, folder, truth=truth, faults=faults, name="today", began="2026-11-01T08:00:00Z")


def verdict_of(run: FakeRun) -> DailyVerdict:
    found = run.journal.last(DailyVerdict)
    assert found is not None, run.outcome.error
    return found


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> FakeRun:
    return run_of(tmp_path_factory.mktemp("first"))


@pytest.fixture(scope="module")
def day(first: FakeRun) -> DayPoints:
    return first.journal.recorded(DailyPointsRow)[0].day


@pytest.fixture
def with_baseline(tmp_path: Path, day: DayPoints) -> Path:
    rng = np.random.default_rng(3)
    for number in range(1, 21):
        earlier_run(tmp_path, number, another_day(day, rng))
    return tmp_path


def shifted(deg: float) -> Truth:
    """The robot of `first` whose A2 has another zero."""
    truth = Truth.of(1)
    still = truth.flange

    def flange() -> np.ndarray:
        joints = truth.joints
        truth.joints = joints + np.array([0.0, deg, 0.0, 0.0, 0.0, 0.0])
        found = still()
        truth.joints = joints
        return found

    truth.flange = flange  # type: ignore[method-assign]
    return truth


def test_the_first_run_begins_a_baseline_and_judges_nothing(first: FakeRun, day: DayPoints) -> None:
    found = verdict_of(first)
    assert first.outcome.state is State.FINISHED, first.outcome.error
    assert (found.verdict, found.passed) == ("baseline", True)
    assert "run 1 of 20" in found.sentence
    assert len(day.points) == 10
    assert not first.journal.recorded(ControlChartRow)


def test_an_unchanged_robot_is_in_control_once_the_baseline_has_20_runs(with_baseline: Path) -> None:
    run = run_of(with_baseline)
    found = verdict_of(run)
    assert (found.verdict, found.passed) == ("in control", True), found.sentence
    assert found.daily.baseline_runs == 20
    assert "0.27 % of runs are beyond the limit" in found.lines[0]
    assert len(run.journal.recorded(EarlierRunsRow)[0].runs) == 20
    assert write_report(run.folder).read_text().count("control-chart") > 0


def test_a_robot_with_another_joint_zero_is_measured_again_and_then_recalibrated(with_baseline: Path) -> None:
    once = run_of(with_baseline, shifted(0.03))
    found = verdict_of(once)
    assert (found.verdict, found.passed) == ("measure again", False)
    assert found.daily.t2 is not None
    assert found.daily.t2_limit is not None
    assert found.daily.t2 > 3.0 * found.daily.t2_limit
    earlier_run(with_baseline, 21, once.journal.recorded(DailyPointsRow)[0].day)
    again = run_fake(PROCEDURE, with_baseline, truth=shifted(0.03), name="again", began="2026-11-01T09:00:00Z")
    found = verdict_of(again)
    assert (found.verdict, found.passed) == ("recalibrate", False)
    assert found.daily.reason != "none"
    assert "Recalibrate." in found.sentence


def test_runs_of_other_points_loads_controllers_and_baselines_are_not_compared(tmp_path: Path, day: DayPoints) -> None:
    earlier_run(tmp_path, 1, replace(day, robot="another"))
    earlier_run(tmp_path, 2, replace(day, commanded=day.commanded[:-1]))
    earlier_run(tmp_path, 3, replace(day, payload_kg=5.0))
    earlier_run(tmp_path, 4, replace(day, baseline="after the repair"))
    earlier_run(tmp_path, 5, day, state="failed")
    earlier_run(tmp_path, 6, day)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "journal.sqlite").write_bytes(b"nonsense")
    row = run_of(tmp_path).journal.recorded(EarlierRunsRow)[0]
    assert [each.run for each in row.runs] == ["daily_check-06"]
    assert dict(row.left_out) == {
        "broken": "its journal is damaged",
        "daily_check-01": "another controller",
        "daily_check-02": "other points",
        "daily_check-03": "another load",
    }


def test_an_instrument_that_stands_elsewhere_each_day_raises_no_alarm(tmp_path: Path, day: DayPoints) -> None:
    rng = np.random.default_rng(4)
    for number in range(1, 21):
        earlier_run(tmp_path, number, another_day(day, rng, elsewhere=True))
    assert verdict_of(run_of(tmp_path)).verdict == "in control"


def test_a_station_that_is_bumped_in_the_run_ends_it_without_a_verdict(tmp_path: Path) -> None:
    run = run_of(tmp_path, faults=Faults(bump_at={12: 2.0}))
    assert run.outcome.state is State.FAILED
    assert "station" in str(run.outcome.error)
    assert run.journal.last(DailyVerdict) is None


@pytest.mark.long
def test_the_share_of_false_alarms_is_the_stated_one(day: DayPoints) -> None:
    rng, limits = np.random.default_rng(5), Limits(false_alarm=0.1)
    found = [charts([another_day(day, rng) for _ in range(21)], limits)[0] for _ in range(300)]
    beyond = sum(each.t2 > each.t2_limit for each in found)
    assert 15 <= beyond <= 48  # 30 expected; 99.9 % of binomial draws


def test_a_slow_drift_is_found_by_the_ewma(day: DayPoints) -> None:
    rng = np.random.default_rng(6)
    days = [another_day(day, rng) for _ in range(20)]
    for step in range(1, 41):
        moved = np.array(day.points) + step * np.array([0.0, 0.0, 0.006])
        days.append(another_day(replace(day, points=tuple(map(tuple, moved.tolist()))), rng))
    actions = [each.action.value for each in charts(days, Limits())]
    assert "recalibrate" in actions
    assert actions[0] == "in control"
