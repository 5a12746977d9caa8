"""What a console makes of the runs: events, alarms that are raised once and clear, and what waits for a person."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cellctl.console import watching
from cellctl.console.alarms import Cause
from cellctl.console.live import LiveRuns
from cellctl.console.overview import calibration_causes, drift_causes, known_cells, rows_of_cells
from cellctl.console.run_queue import PATIENCE, Planned
from cellctl.console.sessions import operator_named
from cellctl.console.watching import Watch
from cellctl.journal import (
    DeviceHealth,
    DevicesConnected,
    InterlockChanged,
    Outcome,
    RunResumed,
    Said,
    StateChanged,
    StepEnded,
    StepFailure,
    StepStarted,
)
from cellctl.operations.fleet import fleet
from cellctl.run_index import RunIndex
from tests.helpers.arms import kr5_model
from tests.helpers.engine import WrittenRun, registry
from tests.helpers.journals import run_in

PATIENCE_S = 60.0
ADA = operator_named("Ada")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watching, "TICK_S", 0.02)


async def until(true: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not true():
            await asyncio.sleep(0.005)


def watched(folder: Path, see: Callable[[Watch], Awaitable[Any]]) -> Any:
    """Watch the runs in `folder` while `see` runs; it begins when all runs of the folder are known."""

    async def go() -> Any:
        live, watch = LiveRuns(folder, registry, look_s=0.01, folder_s=0.02), Watch(folder)
        async with live.following():
            task = asyncio.create_task(watch.run(live))
            await until(lambda: watch._states is not None and watch._lock)
            try:
                return await see(watch)
            finally:
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)

    return asyncio.run(go())


def raised(watch: Watch) -> list[tuple[str, str, str]]:
    return [(alarm.kind, alarm.run, alarm.why) for alarm in watch.alarms.all]


def asked(run: WrittenRun, text: str) -> None:
    run.add(StepStarted("clear", 1, False, "confirm"), Said(text, "clear"))


def lost_device(run: WrittenRun) -> None:
    failure = StepFailure("DeviceLost", "robot: no answer for 1 s\n    check its cable", "check its cable")
    run.add(StepStarted("points[0].measure", 1, True), StepEnded("points[0].measure", 1, Outcome.FAILED, None, failure))


def connected(run: WrittenRun) -> None:
    run.add(DevicesConnected({"robot": {"serial": "1", "simulated": True}}), DeviceHealth("robot", True, "in order"))


def test_a_run_is_followed_by_events_from_its_start_to_its_verdict(tmp_path: Path) -> None:
    async def see(watch: Watch) -> list[Any]:
        found: list[Any] = []
        watch.events.subscribe(lambda event: found.append((event.kind, event.data)))
        run = WrittenRun(tmp_path / "a")
        await until(lambda: ("run_started", "a") in [(kind, data["run"]) for kind, data in found])
        asked(run, "Is the cell clear?")
        await until(lambda: "run_waits" in [kind for kind, _ in found])
        run.add(StepEnded("clear", 1, Outcome.DONE))
        run.measured(0)
        run.judged("It is better.")
        await until(lambda: found[-1][0] == "run_waits" or found[-2][0] == "run_waits")
        run.end()
        await until(lambda: "run_ended" in [kind for kind, _ in found])
        return found

    found = watched(tmp_path, see)
    by_kind = {kind: [data for each, data in found if each == kind] for kind, _ in found}
    assert by_kind["run_started"] == [{"run": "a", "cell": "cell.yaml", "operator": "maria"}]
    assert [data["for"] for data in by_kind["run_waits"]] == ["Is the cell clear?", ""]
    assert by_kind["run_progress"][-1]["total"] == 3 + 1
    assert [data["state"] for data in by_kind["run_state"]][-1] == "finished"
    (end,) = by_kind["run_ended"]
    assert (end["state"], end["verdict"], end["sentence"]) == ("finished", "better", "It is better.")


def test_a_failed_run_raises_one_alarm_not_again_after_a_restart_and_clears_when_it_is_continued(
    tmp_path: Path,
) -> None:
    async def first(watch: Watch) -> None:
        WrittenRun(tmp_path / "a").end("failed")
        await until(lambda: raised(watch) == [("run", "a", "")])

    async def second(watch: Watch) -> None:
        assert raised(watch) == [("run", "a", "")]
        run = WrittenRun.continued(tmp_path / "a")
        run.add(RunResumed("maria", "2026-11-22T11:00:00Z", "", {}), StateChanged("connecting", "running"))
        await until(lambda: raised(watch) == [("run", "a", "the run was continued")])
        run.end("failed")
        await until(lambda: raised(watch) == [("run", "a", ""), ("run", "a", "the run was continued")])
        await watch.alarms.acknowledge(watch.alarms.all[0].id, ADA)

    async def third(watch: Watch) -> None:
        await asyncio.sleep(0.1)
        assert watch.alarms.standing == []
        assert len(watch.alarms.all) == 2

    for see in (first, second, third):
        watched(tmp_path, see)


def test_a_run_that_failed_while_no_console_ran_raises_an_alarm_if_that_was_lately(tmp_path: Path) -> None:
    for name in ("lately", "long_ago", "aborted"):
        WrittenRun(tmp_path / name).end("aborted" if name == "aborted" else "uncertain")
    before = watching.utc_now().timestamp() - 2 * watching.RECENT_S
    os.utime(tmp_path / "long_ago" / "journal.sqlite", (before, before))

    async def see(watch: Watch) -> None:
        await until(lambda: watch.alarms.all)
        await asyncio.sleep(0.1)
        assert raised(watch) == [("run", "lately", "")]

    watched(tmp_path, see)


def test_a_run_that_is_cut_off_raises_an_alarm(tmp_path: Path) -> None:
    async def see(watch: Watch) -> None:
        run = WrittenRun(tmp_path / "a")
        await until(lambda: watch._seen)
        run.journal.close()
        await until(lambda: watch.alarms.all)
        assert "cut off while running" in watch.alarms.all[0].what

    watched(tmp_path, see)


def test_an_interlock_that_does_not_hold_raises_an_alarm_until_it_holds_again(tmp_path: Path) -> None:
    async def see(watch: Watch) -> None:
        run = WrittenRun(tmp_path / "a")
        for _ in range(2):
            run.add(InterlockChanged("guard", "plc", "guard_closed", False, "guard: it is open"))
            await until(lambda: watch.alarms.unseen)
            assert watch.alarms.unseen[0].what == "guard: it is open"
            run.add(InterlockChanged("guard", "plc", "guard_closed", True, ""))
            await until(lambda: not watch.alarms.standing)
        run.add(InterlockChanged("guard", "plc", "guard_closed", False, "guard: it is open"))
        await until(lambda: watch.alarms.standing)
        run.end("aborted")
        await until(lambda: not watch.alarms.standing)
        assert [why for *_, why in raised(watch)] == ["the run has ended", "it holds again", "it holds again"]

    watched(tmp_path, see)


def test_an_alarm_that_stands_is_neither_cleared_nor_raised_again_by_a_restart(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "a")
    run.add(InterlockChanged("guard", "plc", "guard_closed", False, "guard: it is open"))

    async def see(watch: Watch) -> None:
        await until(lambda: raised(watch) == [("interlock", "a", "")] and watch._seen)
        await asyncio.sleep(0.1)
        assert raised(watch) == [("interlock", "a", "")]

    watched(tmp_path, see)
    watched(tmp_path, see)
    run.end()


def test_a_lost_device_raises_an_alarm_until_it_works_in_another_run(tmp_path: Path) -> None:
    async def see(watch: Watch) -> None:
        run = WrittenRun(tmp_path / "a")
        connected(run)
        await until(lambda: watch._seen)
        lost_device(run)
        run.end("failed")
        await until(lambda: {kind for kind, *_ in raised(watch)} == {"device", "run"})
        (alarm,) = [alarm for alarm in watch.alarms.all if alarm.kind == "device"]
        assert (alarm.what, alarm.cure, alarm.cell) == ("robot: no answer for 1 s", "check its cable", "cell")
        second = WrittenRun(tmp_path / "b")
        connected(second)
        await until(lambda: [alarm.kind for alarm in watch.alarms.standing] == ["run"])
        second.end()

    watched(tmp_path, see)


def test_a_control_chart_out_of_limits_raises_an_alarm_until_a_check_is_in_control(tmp_path: Path) -> None:
    run_in(tmp_path, "check-1", "2026-11-24", "925185", "recalibrate")

    async def see(watch: Watch) -> None:
        await until(lambda: raised(watch) == [("chart", "check-1", "")])
        run_in(tmp_path, "check-2", "2026-11-25", "925185", "in control")
        await until(lambda: raised(watch) == [("chart", "check-1", "in control again: check-2")])

    watched(tmp_path, see)


def test_a_calibration_is_due_by_the_age_in_the_cell_file_until_a_newer_run(tmp_path: Path) -> None:
    (tmp_path / "hall7.yaml").write_text("name: hall 7\ndevices: {}\ncalibration_days: 30\n")
    runs = tmp_path / "runs"
    run_in(runs, "old", "2026-01-01", "925185", cell=str(tmp_path / "hall7"))

    async def see(watch: Watch) -> None:
        watch.due = lambda index: calibration_causes(known_cells(tmp_path / "hall7.yaml", rows_of_cells(index)))
        watch._due["calibrations"] = 0.0
        await until(lambda: raised(watch) == [("calibration", "", "")])
        assert "due after 30 days" in watch.alarms.all[0].what
        today = watching.utc_now().strftime("%Y-%m-%d")
        run_in(runs, "new", today, "925185", cell=str(tmp_path / "hall7"))
        while watch.alarms.standing:
            watch._due["calibrations"] = 0.0
            await asyncio.sleep(0.02)
        assert raised(watch) == [("calibration", "", "calibrated")]

    watched(runs, see)


def test_a_robot_whose_parameter_moved_raises_an_alarm_until_its_charts_are_within_their_limits(tmp_path: Path) -> None:
    def robots(index: RunIndex) -> Iterator[tuple[Cause, bool]]:
        return drift_causes(fleet(index, tmp_path, now="2027-01-01T00:00:00Z").robots)

    def calibrated(month: int, zero: float) -> None:
        place = run_in(tmp_path, f"run-{month}", f"2026-{month:02d}-01", "SIM-7")
        kr5_model(errors={"theta3": zero}).save(place / "model.json")

    for month in range(1, 7):
        calibrated(month, 1e-6 * month)
    calibrated(7, 1e-3)

    async def see(watch: Watch) -> None:
        watch.due = robots
        watch._due["calibrations"] = 0.0
        await until(lambda: raised(watch) == [("chart", "", "")])
        assert watch.alarms.all[0].what.startswith("SIM-7 moved: θ3 +0.057")
        for month in range(8, 13):
            calibrated(month, 1e-6 * month)
        async with asyncio.timeout(PATIENCE_S):
            while watch.alarms.standing:
                watch._due["calibrations"] = 0.0
                await asyncio.sleep(0.02)
        assert raised(watch) == [("chart", "", "within its limits")]

    watched(tmp_path, see)


def test_what_waits_for_a_person_is_a_question_a_pause_and_an_offer_and_a_lapsed_offer_is_an_alarm(
    tmp_path: Path,
) -> None:
    async def see(watch: Watch) -> None:
        run = WrittenRun(tmp_path / "a")
        asked(run, "Is the cell clear?")
        await until(lambda: [each.what for each in watch.waiting] == ["a: Is the cell clear?"])
        run.add(StepEnded("clear", 1, Outcome.DONE))
        await until(lambda: watch.waiting == ())
        run.paused_by("Ada")
        await until(lambda: [each.address for each in watch.waiting] == ["/run/a"])
        entry = await watch.queue.add(Planned("test", "cell"), ADA)
        await asyncio.sleep(0.1)
        assert watch.queue.offers == []  # its cell is busy
        run.end("aborted")
        await until(lambda: [each.address for each in watch.waiting] == ["/jobs"])
        now = watch.queue._now() + PATIENCE
        watch.queue._now = lambda: now
        await until(lambda: raised(watch) == [("job", "", "")])
        assert "nobody confirmed it within 10 minutes" in watch.alarms.all[0].what
        await watch.queue.offer_again(entry.id, ADA)
        await until(lambda: [why for *_, why in raised(watch)] == ["it was offered again, or removed"])

    watched(tmp_path, see)


def test_of_two_consoles_on_one_folder_one_raises_alarms_and_the_other_takes_over(tmp_path: Path) -> None:
    async def go() -> None:
        live = LiveRuns(tmp_path, registry, look_s=0.01, folder_s=0.02)
        one, two = Watch(tmp_path), Watch(tmp_path)
        async with live.following():
            first = asyncio.create_task(one.run(live))
            await until(lambda: one._lock)
            second = asyncio.create_task(two.run(live))
            await until(lambda: one._states is not None and two._states is not None)
            WrittenRun(tmp_path / "a").end("failed")
            await until(lambda: one.alarms.all and two.alarms.all)
            assert one.alarms.all == two.alarms.all
            assert not two._lock
            first.cancel()
            await asyncio.gather(first, return_exceptions=True)
            await until(lambda: two._lock)
            WrittenRun(tmp_path / "b").end("failed")
            await until(lambda: raised(two) == [("run", "b", ""), ("run", "a", "")])
            second.cancel()
            await asyncio.gather(second, return_exceptions=True)

    asyncio.run(go())


def test_a_folder_in_which_nothing_can_be_written_stops_neither_events_nor_what_waits(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "alarms.jsonl").mkdir()

    async def see(watch: Watch) -> None:
        WrittenRun(tmp_path / "a").end("failed")
        await until(lambda: caplog.records)
        run = WrittenRun(tmp_path / "b")
        asked(run, "Is the cell clear?")
        await until(lambda: watch.waiting)
        run.end()

    watched(tmp_path, see)
    assert len([record for record in caplog.records if "alarms and offers" in record.getMessage()]) == 1
