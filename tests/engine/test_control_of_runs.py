"""What keeps a run from going on, and who did what to it: interlocks, operators' actions, `confirm` and `if`."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cellctl.clock import WallClock
from cellctl.devices import DeviceFault, DeviceLost, DeviceRefused
from cellctl.engine import AbortedByInterlock, Action, Engine, Mailbox, MailboxFolder, Operator, State
from cellctl.files import InputError
from cellctl.journal import (
    InterlockChanged,
    Journal,
    OperatorAction,
    Outcome,
    RunResumed,
    StateChanged,
    StepEnded,
    fold,
    read_journal,
)
from cellctl.operations.launch import uncertainty
from tests.helpers.engine import CALLS, LOOP, FakeDevice, FakeGate, FakeRobot, engine_for, events_of

PATIENCE_S = 60.0
ME = Operator("maria", "cell-pc", "cli")
FOREVER = "  - {id: wait, do: test.forever}"


def interlock(more: str = "") -> str:
    return f"interlocks:\n  - {{id: door, device: gate, condition: closed{more}}}"


async def until(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not true():
            await asyncio.sleep(0.005)


def ran(engine: Any, meanwhile: Any) -> Any:
    async def go() -> Any:
        running = asyncio.create_task(engine.run())
        await meanwhile()
        async with asyncio.timeout(PATIENCE_S):
            return await running

    return asyncio.run(go())


def paused_reasons(journal: Any) -> list[str]:
    return [event.reason for event in events_of(journal, StateChanged) if event.after == "paused"]


def test_a_break_stops_the_step_and_the_run_goes_on_only_when_it_holds_and_the_operator_says_so(tmp_path: Path) -> None:
    gate = FakeGate("gate")
    engine, mailbox, journal = engine_for(FOREVER, tmp_path, [gate], interlocks=interlock())

    async def meanwhile() -> None:
        await until(lambda: "forever" in CALLS)
        gate.closed = False
        await until(lambda: engine.state is State.PAUSED)
        mailbox.resume(ME)
        await asyncio.sleep(0.2)
        assert engine.state is State.PAUSED
        gate.closed = True
        await until(lambda: len(events_of(journal, InterlockChanged)) == 2)
        assert engine.state is State.PAUSED
        mailbox.resume(ME)
        await until(lambda: len(CALLS) == 2)
        mailbox.abort()

    assert ran(engine, meanwhile).state is State.ABORTED
    assert [event.holds for event in events_of(journal, InterlockChanged)] == [False, True]
    assert paused_reasons(journal) == ["interlock 'door' does not hold (gate: closed)"]
    assert [event.outcome for event in events_of(journal, StepEnded)] == ["cancelled", "cancelled"]
    refused, resumed, _ = events_of(journal, OperatorAction)
    assert (refused.action, refused.refused) == ("resume", "interlock 'door' does not hold (gate: closed)")
    assert (resumed.action, resumed.refused) == ("resume", "")


def test_an_interlock_with_automatic_resume_goes_on_by_itself_unless_the_operator_paused_too(tmp_path: Path) -> None:
    gate = FakeGate("gate")
    gate.closed = False
    engine, mailbox, journal = engine_for(LOOP, tmp_path, [gate], interlocks=interlock(", resume: auto"))

    async def meanwhile() -> None:
        await until(lambda: engine.state is State.PAUSED)
        assert CALLS == []
        mailbox.pause(ME)
        gate.closed = True
        await until(lambda: len(events_of(journal, InterlockChanged)) == 2)
        await asyncio.sleep(0.05)
        assert CALLS == []
        mailbox.resume(ME)

    assert ran(engine, meanwhile).state is State.FINISHED
    assert CALLS == ["double 1", "double 2", "double 3"]


def test_a_break_that_pauses_lets_the_step_end_and_holds_the_next(tmp_path: Path) -> None:
    gate = FakeGate("gate")
    engine, _, journal = engine_for(LOOP, tmp_path, [gate], interlocks=interlock(", on_break: pause, resume: auto"))

    class OpenAfterTheFirst:
        def event(self, event: Any) -> None:
            if isinstance(event, StepEnded) and event.step == "all[0].twice":
                gate.closed = False

        def loop(self, path: str, index: int, count: int) -> None:
            pass

    engine._recorder.watcher = OpenAfterTheFirst()

    async def meanwhile() -> None:
        await until(lambda: engine.state is State.PAUSED)
        assert CALLS == ["double 1"]
        gate.closed = True

    assert ran(engine, meanwhile).state is State.FINISHED
    assert len(paused_reasons(journal)) == 1


class MovesUntilTold(FakeRobot):
    """A robot whose motion ends when the test says so."""

    def __init__(self) -> None:
        super().__init__("robot")
        self.arrived = asyncio.Event()

    async def move(self) -> None:
        await self.arrived.wait()


def test_a_break_that_pauses_does_not_stop_the_step_during_which_it_comes(tmp_path: Path) -> None:
    gate, robot = FakeGate("gate"), MovesUntilTold()
    more = interlock(", on_break: pause, resume: auto")
    engine, _, journal = engine_for(MOVE, tmp_path, [gate, robot], interlocks=more)

    async def meanwhile() -> None:
        await until(lambda: "move" in CALLS)
        gate.closed = False
        await until(lambda: len(events_of(journal, InterlockChanged)) == 1)
        robot.arrived.set()
        await until(lambda: len(events_of(journal, StepEnded)) == 1)
        gate.closed = True

    assert ran(engine, meanwhile).state is State.FINISHED
    assert [event.outcome for event in events_of(journal, StepEnded)] == ["done"]
    assert CALLS == ["move"]


def test_a_break_that_aborts_ends_the_run_with_its_clean_up(tmp_path: Path) -> None:
    gate = FakeGate("gate")
    engine, _, _ = engine_for(
        FOREVER, tmp_path, [gate], "  - {id: hold, do: test.hold}", interlock(", on_break: abort")
    )

    async def meanwhile() -> None:
        await until(lambda: "forever" in CALLS)
        gate.closed = False

    outcome = ran(engine, meanwhile)
    assert outcome.state is State.ABORTED
    assert isinstance(outcome.error, AbortedByInterlock)
    assert "interlock 'door' does not hold" in str(outcome.error)
    assert CALLS == ["forever", "hold"]


def test_no_step_begins_where_an_interlock_that_aborts_is_broken_from_the_start(tmp_path: Path) -> None:
    gate = FakeGate("gate")
    gate.closed = False
    engine, _, _ = engine_for(LOOP, tmp_path, [gate], interlocks=interlock(", on_break: abort"))
    assert asyncio.run(engine.run()).state is State.ABORTED
    assert CALLS == []


class OpensWithTheFailure:
    """A watcher: the gate opens when a step fails, as a guard that stops the robot before anybody reports it."""

    def __init__(self, gate: FakeGate) -> None:
        self._gate = gate

    def event(self, event: Any) -> None:
        if isinstance(event, StepEnded) and event.outcome == "failed":
            self._gate.closed = False

    def loop(self, path: str, index: int, count: int) -> None:
        pass


class Mover(FakeRobot):
    """A robot that moves for ever the first time, and whose stop stays set. `fails`: the move is lost in place."""

    fails = False

    def __init__(self, **how: bool) -> None:
        super().__init__("robot", **how)
        self.stopped = False

    async def stop(self) -> None:
        self.stopped = True
        await super().stop()

    def clear_stop(self) -> None:
        self.stopped = False

    async def move(self) -> None:
        if self.stopped:
            raise DeviceRefused("robot", "a stop is set")
        if CALLS.count("move") > 1:
            return
        if self.fails:
            raise DeviceLost("robot", "the line broke")
        await asyncio.Event().wait()


MOVE = "  - {id: move, do: test.move}"
FLAKY = "  - {id: touch, do: test.flaky}"


def opened(gate: FakeGate, robot: Mover, folder: Path) -> tuple[Any, Any]:
    """A run whose gate opens while the robot moves, and closes once the run is paused; with its journal."""
    engine, _, journal = engine_for(MOVE, folder, [gate, robot], interlocks=interlock(", resume: auto"))

    async def meanwhile() -> None:
        await until(lambda: "move" in CALLS)
        gate.closed = False
        await until(lambda: engine.state is not State.RUNNING)
        gate.closed = True

    return ran(engine, meanwhile), journal


@pytest.mark.parametrize("fails", [False, True])
def test_a_robot_that_an_interlock_stops_is_stopped_and_moves_again_when_the_run_goes_on(
    tmp_path: Path, fails: bool
) -> None:
    robot = Mover()
    robot.fails = fails
    gate = FakeGate("gate")
    if fails:
        engine, _, journal = engine_for(MOVE, tmp_path, [gate, robot], interlocks=interlock(", resume: auto"))
        engine._recorder.watcher = OpensWithTheFailure(gate)

        async def meanwhile() -> None:
            await until(lambda: engine.state is State.PAUSED)
            gate.closed = True

        outcome = ran(engine, meanwhile)
    else:
        outcome, journal = opened(gate, robot, tmp_path)
    assert (outcome.state, CALLS.count("move")) == (State.FINISHED, 2)
    assert robot.calls.count("stop") == 2, "for the pause, and in the clean-up"
    assert not fold(read_journal(journal.path)).uncertain


@pytest.mark.parametrize("fails", [False, True])
def test_where_a_stop_is_not_confirmed_the_run_is_uncertain_whatever_the_interlock_says(
    tmp_path: Path, fails: bool
) -> None:
    robot = Mover(stops=False)
    robot.fails = fails
    gate = FakeGate("gate")
    if fails:
        engine, _, journal = engine_for(MOVE, tmp_path, [gate, robot], interlocks=interlock())
        engine._recorder.watcher = OpensWithTheFailure(gate)
        outcome = asyncio.run(engine.run())
    else:
        outcome, journal = opened(gate, robot, tmp_path)
    assert outcome.state is State.UNCERTAIN
    assert "paused" not in [event.after for event in events_of(journal, StateChanged)]
    for cause in ("robot could not be brought to its safe state: does not stop", "interlock 'door' does not hold"):
        assert cause in str(outcome.error)
    assert ("the line broke" in str(outcome.error)) is fails
    state = fold(read_journal(journal.path))
    assert "could not be brought to its safe state" in uncertainty(state)


def test_a_step_that_left_its_device_uncertain_is_not_done_again_though_an_interlock_breaks_beside_it(
    tmp_path: Path,
) -> None:
    gate = FakeGate("gate")
    lost = "  - {id: push, do: test.lost}"
    engine, _, _ = engine_for(lost, tmp_path, [gate, FakeRobot("robot")], interlocks=interlock(", resume: auto"))
    engine._recorder.watcher = OpensWithTheFailure(gate)

    async def meanwhile() -> None:
        await until(lambda: engine.state is not State.RUNNING)
        gate.closed = True

    outcome = ran(engine, meanwhile)
    assert (outcome.state, CALLS) == (State.UNCERTAIN, ["lost"])
    for cause in ("is gone, and may have moved", "interlock 'door' does not hold"):
        assert cause in str(outcome.error)


@pytest.mark.parametrize("stops", [True, False])
def test_a_motion_that_took_too_long_is_stopped_before_it_is_tried_again(tmp_path: Path, stops: bool) -> None:
    robot = Mover(stops=stops)
    steps = "  - {id: move, do: test.move, timeout: 0.05, retry: {attempts: 2, on: [TimeoutError]}}"
    outcome = asyncio.run(engine_for(steps, tmp_path, [robot])[0].run())
    assert (outcome.state, CALLS.count("move")) == ((State.FINISHED, 2) if stops else (State.UNCERTAIN, 1))
    assert robot.calls.count("stop") == 2, (
        "before the next attempt, or because it is not confirmed; and in the clean-up"
    )


class ShowsMessages(FakeRobot):
    """A robot whose controller shows a message, until somebody acknowledges it."""

    message = False

    def conditions(self) -> dict[str, str]:
        return {"ready": "it shows no message"}

    async def holds(self, condition: str) -> bool:
        return not self.message

    async def move(self) -> None:
        if self.message:
            raise DeviceFault("robot", "shows a message")


def test_a_robot_that_the_gate_stopped_beside_a_step_without_it_is_awaited_before_it_moves(tmp_path: Path) -> None:
    gate, robot = FakeGate("gate"), ShowsMessages("robot")
    steps = f"{FLAKY}\n{MOVE}"
    engine, _, journal = engine_for(steps, tmp_path, [gate, robot], interlocks=interlock(", resume: auto"))
    engine._recorder.watcher = OpensWithTheFailure(gate)

    async def meanwhile() -> None:
        await until(lambda: engine.state is State.PAUSED)
        robot.message = True
        await until(lambda: len(events_of(journal, InterlockChanged)) == 2)
        gate.closed = True
        await until(lambda: len(events_of(journal, InterlockChanged)) == 3)
        await asyncio.sleep(0.2)
        assert engine.state is State.PAUSED
        robot.message = False

    assert ran(engine, meanwhile).state is State.FINISHED
    told = [(event.interlock, event.holds) for event in events_of(journal, InterlockChanged)]
    assert told == [("door", False), ("robot ready", False), ("door", True), ("robot ready", True)]


def test_the_cells_time_stops_only_while_nothing_but_a_robots_message_is_awaited(tmp_path: Path) -> None:
    gate, robot = FakeGate("gate"), ShowsMessages("robot")
    stopped: list[tuple[bool, bool]] = []

    class NotesWhenItStops(WallClock):
        @contextmanager
        def standing(self) -> Iterator[None]:
            stopped.append((gate.closed, robot.message))
            yield

    steps = f"{FLAKY}\n{MOVE}"
    devices: list[FakeDevice] = [gate, robot]
    more = interlock(", resume: auto")
    engine, _, journal = engine_for(steps, tmp_path, devices, interlocks=more, clock=NotesWhenItStops())
    engine._recorder.watcher = OpensWithTheFailure(gate)

    async def meanwhile() -> None:
        await until(lambda: engine.state is State.PAUSED)
        robot.message = True
        await until(lambda: len(events_of(journal, InterlockChanged)) == 2)
        assert stopped == [], "a gate that is open closes in the cell's time"
        gate.closed = True
        await until(lambda: bool(stopped))
        robot.message = False

    assert ran(engine, meanwhile).state is State.FINISHED
    assert set(stopped) == {(True, True)}


def test_a_run_that_was_killed_between_a_failure_and_the_stop_is_uncertain(tmp_path: Path) -> None:
    robot, gate = Mover(), FakeGate("gate")
    outcome, journal = opened(gate, robot, tmp_path)
    assert outcome.state is State.FINISHED
    entries = list(read_journal(journal.path))
    ends = [place for place, entry in enumerate(entries) if isinstance(entry.event, StepEnded)]
    cut = fold(entries[: ends[0] + 1])
    assert cut.uncertain
    assert uncertainty(cut) == "the run was cut off after move had failed, before its devices were known to stand"
    paused = next(place for place, entry in enumerate(entries) if getattr(entry.event, "after", "") == "paused")
    assert not fold(entries[: paused + 1]).uncertain


def test_a_step_that_failed_because_an_interlock_broke_is_done_again_and_the_run_does_not_fail(tmp_path: Path) -> None:
    gate = FakeGate("gate")
    engine, _, journal = engine_for(FLAKY, tmp_path, [gate], interlocks=interlock(", resume: auto"))
    engine._recorder.watcher = OpensWithTheFailure(gate)

    async def meanwhile() -> None:
        await until(lambda: engine.state is State.PAUSED)
        gate.closed = True

    assert ran(engine, meanwhile).state is State.FINISHED
    assert [event.outcome for event in events_of(journal, StepEnded)] == ["failed", "done"]
    assert paused_reasons(journal) == ["interlock 'door' does not hold (gate: closed)"]


def test_an_interlock_that_aborts_is_the_reason_and_not_the_failure_that_came_first(tmp_path: Path) -> None:
    gate = FakeGate("gate")
    engine, _, _ = engine_for(FLAKY, tmp_path, [gate], interlocks=interlock(", on_break: abort"))
    engine._recorder.watcher = OpensWithTheFailure(gate)
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.ABORTED
    assert "interlock 'door' does not hold" in str(outcome.error)


def test_a_failure_with_no_broken_interlock_fails_the_run_as_before(tmp_path: Path) -> None:
    engine, _, _ = engine_for(FLAKY, tmp_path, [FakeGate("gate")], interlocks=interlock())
    outcome = asyncio.run(engine.run())
    assert outcome.state is State.FAILED
    assert "nothing there" in str(outcome.error)


def test_a_device_that_no_longer_says_breaks_its_interlock(tmp_path: Path) -> None:
    gate = FakeGate("gate")
    gate.lost = True
    engine, mailbox, journal = engine_for(LOOP, tmp_path, [gate], interlocks=interlock())

    async def meanwhile() -> None:
        await until(lambda: engine.state is State.PAUSED)
        mailbox.abort()

    assert ran(engine, meanwhile).state is State.ABORTED
    assert paused_reasons(journal) == ["interlock 'door': gate: is silent"]


def test_a_condition_that_the_device_has_not_is_refused_before_any_step(tmp_path: Path) -> None:
    engine, _, _ = engine_for(LOOP, tmp_path, [FakeDevice("gate")], interlocks=interlock())
    outcome = asyncio.run(engine.run())
    assert isinstance(outcome.error, InputError)
    assert "'gate' has no condition 'closed'" in str(outcome.error)
    assert CALLS == []


def test_a_confirm_step_waits_for_the_operator_and_the_journal_says_who_and_when(tmp_path: Path) -> None:
    steps = '  - {id: clear, confirm: "Is the cell clear?"}\n  - {id: hold, do: test.hold}'
    engine, mailbox, journal = engine_for(steps, tmp_path)

    async def meanwhile() -> None:
        await until(lambda: engine._record.in_flight != ())
        await asyncio.sleep(0.02)
        assert CALLS == []
        mailbox.confirm(ME)
        mailbox.confirm(ME)

    assert ran(engine, meanwhile).state is State.FINISHED
    assert CALLS == ["hold"]
    assert events_of(journal, StepEnded)[0].result == {"name": "maria", "host": "cell-pc", "via": "cli"}
    action, again = events_of(journal, OperatorAction)
    assert (action.action, action.operator, action.host, action.via) == ("confirm", "maria", "cell-pc", "cli")
    assert action.calendar.endswith("Z") or "+" in action.calendar
    assert again.refused == "the run waits for no confirmation"


def test_a_confirmation_that_does_not_come_fails_the_step_and_confirm_all_gives_each(tmp_path: Path) -> None:
    engine, _, _ = engine_for("  - {id: clear, confirm: Clear, timeout: 0.05}", tmp_path / "one")
    assert "clear: not done within 0.05 s" in str(asyncio.run(engine.run()).error)
    engine, mailbox, journal = engine_for("  - {id: clear, confirm: Clear}", tmp_path / "two")
    mailbox.confirm_all = Operator("maria", "cell-pc", "--confirm-all")
    assert asyncio.run(engine.run()).state is State.FINISHED
    assert events_of(journal, OperatorAction)[0].via == "--confirm-all"


BRANCH = """
  - {id: some, do: test.numbers}
  - id: many
    if: ${some.values[2]} > 2
    then:
      - {id: first, do: test.double, with: {value: 10}}
      - {id: last, do: test.forever}
    else:
      - {id: other, do: test.double, with: {value: 20}}
"""


def test_a_resumed_run_takes_the_branch_that_it_took_before_and_its_steps_keep_their_names(tmp_path: Path) -> None:
    engine, mailbox, journal = engine_for(BRANCH, tmp_path)

    async def meanwhile() -> None:
        await until(lambda: "forever" in CALLS)
        mailbox.abort()

    assert ran(engine, meanwhile).state is State.ABORTED
    journal.close()
    record = fold(read_journal(journal.path))
    assert record.finished["many"] == {"value": True}
    assert "many.first" in record.finished
    record.steps["many"] = type(record.steps["many"])("many", 1, False, Outcome.DONE, {"value": False})
    CALLS.clear()
    with Journal.reopen(journal.path.parent, engine._clock.now_ns) as again:
        again.append(RunResumed("me", "now", "", {}))
        outcome = asyncio.run(Engine(engine._plan, engine._run, again, Mailbox(), None, record).run())
    assert outcome.state is State.FINISHED
    assert CALLS == ["double 20"]  # as the record says, not as the expression would be decided now


def test_an_action_left_in_the_mailbox_folder_is_taken_recorded_and_deleted(tmp_path: Path) -> None:
    engine, _, journal = engine_for(FOREVER, tmp_path)
    folder = MailboxFolder(tmp_path)
    folder.put("abort", ME, "from an earlier process")
    folder.clear()

    async def meanwhile() -> None:
        await until(lambda: "forever" in CALLS)
        await asyncio.sleep(0.3)
        assert engine.state is State.RUNNING
        (tmp_path / "mailbox").mkdir(exist_ok=True)
        (tmp_path / "mailbox" / "broken.json").write_text("{")
        (tmp_path / "mailbox" / "strange.json").write_text(json.dumps({"action": "dance", "id": "1"}))
        folder.put("abort", ME, "enough")

    outcome = ran(engine, meanwhile)
    assert (outcome.state, str(outcome.error)) == (State.ABORTED, "enough")
    (action,) = events_of(journal, OperatorAction)
    assert (action.operator, action.host, action.via, action.text) == ("maria", "cell-pc", "cli", "enough")
    assert action.id
    assert not (tmp_path / "mailbox").exists()


def test_an_abort_that_comes_while_the_run_starts_ends_it(tmp_path: Path) -> None:
    engine, _, _ = engine_for(FOREVER, tmp_path)
    MailboxFolder(tmp_path).put("abort", ME, "not now")
    outcome = asyncio.run(engine.run())
    assert (outcome.state, str(outcome.error)) == (State.ABORTED, "not now")


def test_what_is_asked_at_the_wrong_time_is_refused_with_the_reason(tmp_path: Path) -> None:
    engine, mailbox, journal = engine_for(FOREVER, tmp_path)

    async def meanwhile() -> None:
        await until(lambda: "forever" in CALLS)
        mailbox.resume(ME)
        mailbox.pause(ME)
        mailbox.pause(ME)
        mailbox.abort()
        mailbox.abort()

    assert ran(engine, meanwhile).state is State.ABORTED
    assert [event.refused for event in events_of(journal, OperatorAction)] == [
        "the run is not paused",
        "",
        "the run is paused already",
        "",
        "the run is ending already",
    ]


@pytest.mark.parametrize("text", ["${some.values}", "${some.none} > 1"])
def test_an_if_that_cannot_be_decided_is_an_error_of_the_procedure_at_its_place(text: str, tmp_path: Path) -> None:
    steps = f"  - {{id: some, do: test.numbers}}\n  - id: many\n    if: {text}\n    then: [{{id: hold, do: test.hold}}]"
    engine, _, _ = engine_for(steps, tmp_path)
    outcome = asyncio.run(engine.run())
    assert isinstance(outcome.error, InputError)
    assert "test.yaml:8:" in str(outcome.error)


@pytest.mark.parametrize(("simulated", "why"), [(False, "the cell is real"), (True, "waits for no reset")])
def test_the_reset_of_a_real_cell_is_refused_and_so_is_one_that_nothing_waits_for(
    tmp_path: Path, simulated: bool, why: str
) -> None:
    engine, mailbox, journal = engine_for(FOREVER, tmp_path)
    presses = []

    async def press() -> None:
        presses.append("reset")

    async def act() -> None:
        running = asyncio.create_task(engine.run())
        await until(lambda: "forever" in CALLS)
        mailbox.post(Action("reset", ME))
        mailbox.abort()
        await running

    engine._control._reset = press if simulated else None
    asyncio.run(act())
    assert why in events_of(journal, OperatorAction)[0].refused
    assert presses == []
