"""What a user relies on from the engine: order, results, retries, time-outs, abort, clean-up, and an honest journal."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from cellctl.devices import DeviceLost, Health, NoContact
from cellctl.engine import ENDS, TRANSITIONS, Aborted, Engine, IllegalTransition, Mailbox, NobodyWatching, State
from cellctl.engine._states import checked
from cellctl.journal import (
    DeviceHealth,
    Journal,
    Recorded,
    RunEnded,
    RunResumed,
    StateChanged,
    StepEnded,
    StepStarted,
    fold,
    read_journal,
)
from tests.helpers.engine import (
    CALLS,
    LOOP,
    AttemptRow,
    DoubledRow,
    FakeDevice,
    FakeGate,
    FakeRobot,
    engine_for,
    events_of,
)


def test_results_flow_from_step_to_step_and_loops_name_each_pass(tmp_path: Path) -> None:
    engine, _, journal = engine_for(LOOP, tmp_path)
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.FINISHED
    assert CALLS == ["double 1", "double 2", "double 3"]
    ended = events_of(journal, StepEnded)
    assert [event.step for event in ended] == ["some", "all[0].twice", "all[1].twice", "all[2].twice"]
    assert ended[-1].result == {"value": 6}


def test_every_attempt_is_an_event_and_rows_of_failed_attempts_do_not_count(tmp_path: Path) -> None:
    steps = "  - {id: touch, do: test.flaky, retry: {attempts: 2, on: [NoContact]}}"
    engine, _, journal = engine_for(steps, tmp_path)
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.FINISHED
    assert [event.outcome for event in events_of(journal, StepEnded)] == ["failed", "done"]
    assert [event.attempt for event in events_of(journal, StepStarted)] == [1, 2]
    assert len(events_of(journal, Recorded)) == 2
    assert engine._record.recorded(AttemptRow) == [AttemptRow(2)]


def test_an_error_that_retry_does_not_name_ends_the_run_and_is_cleaned_up(tmp_path: Path) -> None:
    device = FakeDevice("robot")
    steps = "  - {id: touch, do: test.flaky, retry: {attempts: 3, on: [DeviceLost]}}"
    engine, _, journal = engine_for(steps, tmp_path, [device], "  - {id: hold, do: test.hold}")
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.FAILED
    assert isinstance(outcome.error, NoContact)
    assert CALLS == ["hold"]
    assert device.calls == ["connect", "stop", "close"]
    assert len([event for event in events_of(journal, StepStarted) if event.step == "touch"]) == 1


def test_a_step_that_takes_too_long_is_ended_and_says_so(tmp_path: Path) -> None:
    engine, _, journal = engine_for("  - {id: wait, do: test.forever, timeout: 0.05}", tmp_path)
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.FAILED
    assert "wait: not done within 0.05 s" in str(outcome.error)
    assert events_of(journal, StepEnded)[0].outcome == "timed_out"


@pytest.mark.parametrize("limit", ["", ", timeout: 60"])
def test_a_timeout_inside_a_step_is_not_the_steps_own_limit(limit: str, tmp_path: Path) -> None:
    engine, _, journal = engine_for(f"  - {{id: ask, do: test.times_out{limit}}}", tmp_path)
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.FAILED
    assert str(outcome.error) == "ask: a wait inside the step took too long"
    assert events_of(journal, StepEnded)[0].outcome == "timed_out"


def test_an_uncertain_step_is_not_tried_again_though_retry_names_its_base_class(tmp_path: Path) -> None:
    steps = "  - {id: move, do: test.lost, retry: {attempts: 3, on: [DeviceLost]}}"
    engine, _, _ = engine_for(steps, tmp_path)
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.UNCERTAIN
    assert CALLS == ["lost"]


def test_cancelling_the_caller_cleans_up_and_is_raised_afterwards(tmp_path: Path) -> None:
    device = FakeDevice("robot")
    engine, _, journal = engine_for(
        "  - {id: wait, do: test.forever}", tmp_path, [device], "  - {id: hold, do: test.hold}"
    )

    async def run() -> Any:
        running = asyncio.create_task(engine.run())
        while "forever" not in CALLS:
            await asyncio.sleep(0)
        running.cancel()
        await running

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(run())
    assert CALLS == ["forever", "hold"]
    assert device.calls == ["connect", "stop", "close"]
    ended = fold(read_journal(journal.path)).ended
    assert ended is not None
    assert ended.state == "aborted"


def test_abort_cancels_the_step_and_cleans_up_even_when_said_twice(tmp_path: Path) -> None:
    device = FakeDevice("robot")
    engine, mailbox, journal = engine_for(
        "  - {id: wait, do: test.forever}", tmp_path, [device], "  - {id: hold, do: test.hold}"
    )

    async def run() -> Any:
        running = asyncio.create_task(engine.run())
        while "forever" not in CALLS:
            await asyncio.sleep(0)
        mailbox.abort()
        mailbox.abort()
        return await running

    outcome = asyncio.run(run())
    assert outcome.state is State.ABORTED
    assert isinstance(outcome.error, Aborted)
    assert CALLS == ["forever", "hold"]
    assert device.calls == ["connect", "stop", "close"]
    assert events_of(journal, StepEnded)[0].outcome == "cancelled"


def test_clean_up_tries_everything_and_what_fails_in_it_is_uncertain(tmp_path: Path) -> None:
    devices = [FakeDevice("robot", stops=False), FakeDevice("probe")]
    cleanup = "  - {id: first, do: test.broken}\n  - {id: hold, do: test.hold}"
    engine, _, _ = engine_for("  - {id: some, do: test.numbers}", tmp_path, devices, cleanup)
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.UNCERTAIN
    assert CALLS == ["hold"]
    assert [device.calls[-1] for device in devices] == ["close", "close"]
    assert len(outcome.troubles) == 2


def test_a_cell_of_which_nobody_answers_names_every_device_and_runs_nothing(tmp_path: Path) -> None:
    devices = [FakeDevice("robot", reachable=False), FakeDevice("probe", reachable=False), FakeDevice("plc")]
    engine, _, _ = engine_for(LOOP, tmp_path, devices)
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.FAILED
    assert "robot: nobody answers" in str(outcome.error)
    assert "probe: nobody answers" in str(outcome.error)
    assert CALLS == []
    assert all(device.calls[-1] == "close" for device in devices)


def test_a_full_disk_ends_the_run_and_nothing_is_done_that_the_journal_does_not_hold(tmp_path: Path) -> None:
    device = FakeDevice("robot")
    loop = f"""
  - id: all
    for_each: {list(range(500))}
    as: number
    steps:
      - {{id: twice, do: test.double, with: {{value: "${{number}}"}}}}
"""
    engine, _, journal = engine_for(loop, tmp_path, [device])
    pages = journal._connection.execute("PRAGMA page_count").fetchone()[0]
    journal._connection.execute(f"PRAGMA max_page_count = {pages + 2}")
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.FAILED
    assert "disk is full" in str(outcome.error)
    assert 0 < len(CALLS) < 500
    started = [event.step for event in events_of(journal, StepStarted)]
    assert started == [f"all[{index}].twice" for index in range(len(CALLS))]
    assert device.calls == ["connect", "stop", "close"]


def test_a_pause_holds_between_steps_until_resumed(tmp_path: Path) -> None:
    engine, mailbox, journal = engine_for(LOOP, tmp_path)

    async def run() -> Any:
        mailbox.pause()
        running = asyncio.create_task(engine.run())
        while engine.state is not State.PAUSED:
            await asyncio.sleep(0)
        assert CALLS == []
        mailbox.resume()
        return await running

    assert asyncio.run(run()).state is State.FINISHED
    assert "paused" in [event.after for event in events_of(journal, StateChanged)]


def test_the_transition_table_names_every_state_and_nothing_leaves_an_end() -> None:
    assert set(TRANSITIONS) == set(State)
    assert all(not TRANSITIONS[end] for end in ENDS)
    reachable, frontier = {State.IDLE}, {State.IDLE}
    while frontier:
        frontier = {following for state in frontier for following in TRANSITIONS[state]} - reachable
        reachable |= frontier
    assert reachable == set(State)
    with pytest.raises(IllegalTransition):
        checked(State.FINISHED, State.RUNNING)


def test_a_resumed_run_does_not_repeat_what_is_done_and_loses_no_row(tmp_path: Path) -> None:
    engine, mailbox, journal = engine_for(LOOP, tmp_path)

    class PauseAfterTheSecond:
        def event(self, event: Any) -> None:
            if isinstance(event, StepEnded) and event.step == "all[1].twice":
                mailbox.pause()

        def loop(self, path: str, index: int, count: int) -> None:
            pass

    engine._recorder.watcher = PauseAfterTheSecond()

    async def stop_after_the_second() -> Any:
        running = asyncio.create_task(engine.run())
        async with asyncio.timeout(60):
            while engine.state is not State.PAUSED:
                await asyncio.sleep(0)
            mailbox.abort()
            return await running

    assert asyncio.run(stop_after_the_second()).state is State.ABORTED
    journal.close()
    CALLS.clear()
    record = fold(read_journal(journal.path))
    plan, run = engine._plan, engine._run
    with Journal.reopen(journal.path.parent, run.clock.now_ns) as again:
        again.append(RunResumed("me", "now", "", {}))
        outcome = asyncio.run(Engine(plan, run, again, Mailbox(), None, record).run())
    assert outcome.state is State.FINISHED
    assert CALLS == ["double 3"]
    assert fold(read_journal(journal.path)).recorded(DoubledRow) == [DoubledRow(2), DoubledRow(4), DoubledRow(6)]


def test_an_abort_before_anything_began_is_an_abort_and_connects_nothing(tmp_path: Path) -> None:
    device = FakeDevice("robot")
    engine, mailbox, journal = engine_for(LOOP, tmp_path, [device])
    mailbox.abort()
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.ABORTED
    assert device.calls == []
    assert fold(read_journal(journal.path)).state == "aborted"


def test_a_device_that_cannot_be_closed_keeps_no_other_from_being_closed(tmp_path: Path) -> None:
    devices = [FakeDevice("robot"), FakeDevice("probe")]

    async def broken() -> None:
        raise RuntimeError("does not close")

    devices[0].close = broken  # type: ignore[method-assign]
    engine, _, journal = engine_for("  - {id: some, do: test.numbers}", tmp_path, devices)
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.UNCERTAIN
    assert devices[1].calls == ["connect", "stop", "close"]
    assert fold(read_journal(journal.path)).ended is not None


def test_a_display_that_fails_ends_no_campaign(tmp_path: Path) -> None:
    engine, _, _ = engine_for(LOOP, tmp_path)

    class Gone:
        def event(self, event: Any) -> None:
            raise BrokenPipeError

        def loop(self, path: str, index: int, count: int) -> None:
            raise BrokenPipeError

    engine._recorder.watcher = Gone()
    assert asyncio.run(engine.run()).state is State.FINISHED
    assert CALLS == ["double 1", "double 2", "double 3"]


@pytest.mark.parametrize(
    ("steps", "robot", "moved", "held"),
    [
        ("  - {id: some, do: test.numbers}", FakeRobot("robot"), False, True),
        ("  - {id: touch, do: test.flaky}", FakeRobot("robot"), True, True),
        ("  - {id: touch, do: test.flaky}", FakeRobot("robot", stops=False), True, False),
        ("  - {id: touch, do: test.flaky}", FakeRobot("robot", reachable=False), False, False),
        ("  - {id: touch, do: test.flaky}", FakeDevice("plc"), True, False),
    ],
    ids=["planned only", "moved", "does not stop", "not connected", "no robot"],
)
def test_a_robot_is_held_only_where_it_was_connected_and_confirmed_its_stop(
    steps: str, robot: FakeDevice, moved: bool, held: bool, tmp_path: Path
) -> None:
    engine, _, _ = engine_for(steps, tmp_path, [robot])
    outcome = asyncio.run(engine.run())
    assert (outcome.moved, outcome.held) == (moved, held)


def test_a_robot_that_confirmed_its_stop_is_held_though_another_device_was_not_reached(tmp_path: Path) -> None:
    devices = [FakeRobot("robot"), FakeDevice("probe", reachable=False)]
    engine, _, _ = engine_for("  - {id: touch, do: test.flaky}", tmp_path, devices)
    outcome = asyncio.run(engine.run())
    assert (outcome.moved, outcome.held) == (False, True)


def test_a_clean_up_step_that_writes_has_moved_nothing_where_no_step_was_begun(tmp_path: Path) -> None:
    device = FakeRobot("robot", reachable=False)
    engine, _, journal = engine_for(LOOP, tmp_path, [device], "  - {id: withdraw, do: test.flaky}")
    outcome = asyncio.run(engine.run())
    assert fold(read_journal(journal.path)).steps["cleanup.withdraw"].moves
    assert not outcome.moved


def test_a_clean_up_step_sees_what_a_failed_attempt_recorded(tmp_path: Path) -> None:
    engine, _, _ = engine_for("  - {id: touch, do: test.flaky}", tmp_path, cleanup="  - {id: look, do: test.look}")
    assert asyncio.run(engine.run()).state is State.FAILED
    assert CALLS == ["counts 0, recorded 1"]


def test_who_aborted_a_run_is_reported_at_its_end(tmp_path: Path) -> None:
    engine, mailbox, journal = engine_for(LOOP, tmp_path)
    mailbox.abort("aborted: the shell has ended")
    mailbox.abort()
    assert str(asyncio.run(engine.run()).error) == "aborted: the shell has ended"
    ended = fold(read_journal(journal.path)).ended
    assert ended is not None
    assert ended.reason == "aborted: the shell has ended"


class FakePlc(FakeGate):
    """A fake device that counts as the cell's PLC. `emergency_stop_ok`: its only input."""

    emergency_stop_ok = True

    async def inputs(self) -> dict[str, bool]:
        if self.lost:
            raise DeviceLost(self.name, "is silent")
        return {"emergency_stop_ok": self.emergency_stop_ok}

    def _(self) -> None: ...

    set_output = temperatures = weather = _


def test_the_journal_has_the_health_of_each_device_and_every_change_of_the_inputs_between_steps(tmp_path: Path) -> None:
    plc = FakePlc("plc")
    engine, _, journal = engine_for(LOOP, tmp_path, [FakeDevice("robot"), plc])
    watched = iter([True, False, False, True])

    class Pressing(NobodyWatching):
        def event(self, event: Any) -> None:
            if isinstance(event, StepEnded):
                plc.emergency_stop_ok = next(watched)

    engine._recorder.watcher = Pressing()
    asyncio.run(engine.run())
    reported = [(found.device, found.inputs.get("emergency_stop_ok")) for found in events_of(journal, DeviceHealth)]
    assert reported == [("robot", None), ("plc", True), ("plc", False)]
    assert engine._record.health["plc"].inputs == {"emergency_stop_ok": False}


def test_a_device_that_was_lost_after_its_last_step_fails_the_run_and_says_so(tmp_path: Path) -> None:
    robot = FakeDevice("robot")

    async def health() -> Health:
        if "hold" in CALLS:
            raise DeviceLost("robot", "its other half ended")
        return Health(True, "well")

    robot.health = health  # type: ignore[method-assign]
    engine, _, _ = engine_for("  - {id: hold, do: test.hold}", tmp_path, [robot])
    CALLS.clear()
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.FAILED
    assert "its other half ended" in str(outcome.error)


def test_a_failed_run_records_what_its_devices_report_last_and_where_its_robot_is(tmp_path: Path) -> None:
    plc = FakePlc("plc")
    engine, _, journal = engine_for("  - {id: a, do: test.lost}", tmp_path, [FakeRobot("robot"), plc])

    class Pressing(NobodyWatching):
        def event(self, event: Any) -> None:
            if isinstance(event, StepStarted):
                plc.emergency_stop_ok = False

    engine._recorder.watcher = Pressing()
    outcome = asyncio.run(engine.run())
    reported = [(found.device, found.inputs.get("emergency_stop_ok")) for found in events_of(journal, DeviceHealth)]
    assert reported == [("robot", None), ("plc", True), ("robot", None), ("plc", False)]
    (ended,) = events_of(journal, RunEnded)
    assert (ended.robot, ended.troubles) == (outcome.robot, ())
    assert "the robot is held" in ended.robot
    assert ended.calendar.endswith("Z")
