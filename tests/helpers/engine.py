"""A family of small steps, fake devices, an engine that runs a procedure of them, and journals of such runs.

A `WrittenRun` is a journal that a test writes event by event, as an engine would, for what follows it. `Running` is a
small campaign with a `confirm` step and an interlock, which runs in a thread as another process would run it.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from cellctl.clock import WallClock
from cellctl.devices import DeviceLost, DeviceUncertain, DeviceUnreachable, Health, Identity, MovingRobot, NoContact
from cellctl.engine import Engine, Mailbox, Plan, Surround
from cellctl.engine.status import KnownProcedure
from cellctl.files import parse_yaml, sha256_of
from cellctl.journal import (
    Journal,
    OperatorAction,
    Outcome,
    Recorded,
    RunEnded,
    RunStarted,
    Said,
    SourceFile,
    StateChanged,
    StepEnded,
    StepStarted,
    fold,
    read_journal,
)
from cellctl.procedure import NoInputs, StepContext, StepInputs, StepRegistry, StepResult, read_procedure, step
from cellctl.records import Row

CALLS: list[str] = []

PROCEDURE = """
procedure: test
title: Measure each point
steps:
  - {id: plan, do: test.numbers}
  - id: points
    title: Measure
    for_each: ${plan.values}
    as: number
    steps:
      - {id: measure, do: test.double, with: {value: "${number}"}}
"""

PATIENCE_S = 60.0
TEXT = """
procedure: test
title: a test
cell: cell.yaml
interlocks:
  - {id: door, device: gate, condition: closed}
steps:
  - {id: some, do: test.numbers}
  - {id: clear, confirm: Clear the cell}
  - id: all
    for_each: ${some.values}
    as: number
    steps:
      - {id: twice, do: test.double, with: {value: "${number}"}}
  - {id: wait, do: test.forever}
"""


class Numbers(StepResult):
    values: list[int]


class Value(StepInputs):
    value: int


class Doubled(StepResult):
    value: int


@dataclass(frozen=True)
class DoubledRow(Row):
    KIND = "doubled"
    value: int


@dataclass(frozen=True)
class AttemptRow(Row):
    KIND = "row"
    attempt: int


@step("test.numbers")
async def numbers(context: StepContext, inputs: NoInputs) -> Numbers:
    """Give three numbers."""
    return Numbers(values=[1, 2, 3])


@step("test.double")
async def double(context: StepContext, inputs: Value) -> Doubled:
    """Double a number."""
    CALLS.append(f"double {inputs.value}")
    await context.record(DoubledRow(2 * inputs.value))
    return Doubled(value=2 * inputs.value)


@step("test.flaky", moves=True)
async def flaky(context: StepContext, inputs: NoInputs) -> None:
    """Fail at the first attempt, after recording something."""
    await context.record(AttemptRow(context.attempt))
    if context.attempt == 1:
        raise NoContact("probe", "nothing there")


@step("test.forever", moves=True)
async def forever(context: StepContext, inputs: NoInputs) -> None:
    """Never end."""
    CALLS.append("forever")
    await asyncio.Event().wait()


@step("test.broken")
async def broken(context: StepContext, inputs: NoInputs) -> None:
    """Raise what nobody foresaw."""
    raise ZeroDivisionError("broken on purpose")


@step("test.lost", moves=True)
async def lost(context: StepContext, inputs: NoInputs) -> None:
    """Lose the device in a motion."""
    CALLS.append("lost")
    raise DeviceUncertain("robot", "is gone, and may have moved")


@step("test.times_out")
async def times_out(context: StepContext, inputs: NoInputs) -> None:
    """Raise a TimeoutError without a text, as many libraries do."""
    raise TimeoutError


@step("test.hold")
async def hold(context: StepContext, inputs: NoInputs) -> None:
    """Say that it was called."""
    CALLS.append("hold")


@step("test.move", needs={"robot": MovingRobot})
async def move(context: StepContext, inputs: NoInputs) -> None:
    """Move, which is refused while a stop is set; the first time for ever, or as long as the controller lives."""
    CALLS.append("move")
    await context.device("robot").move()


@step("test.look")
async def look(context: StepContext, inputs: NoInputs) -> None:
    """Note what the step `touch` recorded."""
    CALLS.append(f"counts {len(context.recorded(AttemptRow))}, recorded {len(context.all_recorded(AttemptRow))}")


KINDS = [numbers, double, flaky, forever, broken, lost, times_out, hold, look, move]


class FakeDevice:
    """A device that notes what is done to it."""

    def __init__(self, name: str, *, reachable: bool = True, stops: bool = True) -> None:
        self.name = name
        self.calls: list[str] = []
        self._reachable = reachable
        self._stops = stops

    async def connect(self) -> Identity:
        self.calls.append("connect")
        if not self._reachable:
            raise DeviceUnreachable(self.name, "nobody answers")
        return Identity(self.name, "SIM-1", "fake", "1", simulated=True)

    async def health(self) -> Health:
        return Health(True, "well")

    async def stop(self) -> None:
        self.calls.append("stop")
        if not self._stops:
            raise RuntimeError("does not stop")

    async def close(self) -> None:
        self.calls.append("close")


class FakeRobot(FakeDevice):
    """A fake device that counts as a robot."""

    axes = 6

    def _(self) -> None: ...

    joints = move = search = stop_now = clear_stop = guard = _


class FakeGate(FakeDevice):
    """A fake device with one condition: its door is closed. `lost`: it does not say any more."""

    closed = True
    lost = False

    def conditions(self) -> dict[str, str]:
        return {"closed": "the door is closed"}

    async def holds(self, condition: str) -> bool:
        if self.lost:
            raise DeviceLost(self.name, "is silent")
        return self.closed


def engine_for(
    steps: str,
    folder: Path,
    devices: list[FakeDevice] | None = None,
    cleanup: str = "",
    interlocks: str = "",
    clock: WallClock | None = None,
) -> Any:
    CALLS.clear()
    text = f"procedure: test\ntitle: a test\ncell: cell.yaml\n{interlocks}\nsteps:\n{steps}"
    if cleanup:
        text += f"\ncleanup:\n{cleanup}"
    procedure = read_procedure(parse_yaml(text, "test.yaml"))
    assert procedure.problems == ()
    clock = clock or WallClock()
    named = {device.name: device for device in devices or [FakeDevice("robot")]}
    surround = Surround(clock, 1, folder, parse_yaml("name: x", "cell.yaml"), folder / "robot.yaml", named)
    journal = Journal.create(folder / "run", clock.now_ns)
    mailbox = Mailbox()
    return Engine(Plan(procedure, {}, StepRegistry(KINDS), named), surround, journal, mailbox), mailbox, journal


def events_of(journal: Journal, kind: type) -> list[Any]:
    return [entry.event for entry in read_journal(journal.path) if isinstance(entry.event, kind)]


def started(engine: Any, clock: str = "realtime") -> RunStarted:
    """The first event of a run of this engine's procedure: an engine alone does not record it."""
    source = SourceFile("test.yaml", engine._plan.procedure.text, "0")
    calendar = "2026-11-22T10:00:00Z"
    return RunStarted(source, SourceFile("cell.yaml", "name: x", "0"), {}, 1, clock, "maria", calendar, "0", {})


def known_procedure(engine: Any) -> KnownProcedure:
    """The procedure as it is read from that event."""
    known = KnownProcedure.of(started(engine), engine._plan.registry)
    assert known is not None
    return known


LOOP = """
  - {id: some, do: test.numbers}
  - id: all
    for_each: ${some.values}
    as: number
    steps:
      - {id: twice, do: test.double, with: {value: "${number}"}}
"""


def registry() -> StepRegistry:
    """The kinds of steps of these journals."""
    return StepRegistry(KINDS)


class WrittenRun:
    """A run in `folder` of `points` points whose journal the test writes; it is running after its start."""

    def __init__(self, folder: Path, points: int = 3, calendar: str = "2026-11-22T10:00:00Z") -> None:
        self.folder, self.points, self._ns = folder, points, 0
        self.journal = Journal.create(folder, self._now_ns)
        source = SourceFile("test.yaml", PROCEDURE, "0")
        cell = SourceFile("cell.yaml", "name: x", "0")
        self.add(RunStarted(source, cell, {}, 1, "realtime", "maria", calendar, "0", {}, name=folder.name))
        self.add(StateChanged("connecting", "running"))
        self.did("plan", {"values": list(range(points))})

    @classmethod
    def continued(cls, folder: Path) -> Self:
        """The run in `folder`, written by another process before."""
        run = cls.__new__(cls)
        run.folder, run.points, run._ns = folder, 3, 10**10
        run.reopen()
        return run

    def _now_ns(self) -> int:
        self._ns += 100_000_000
        return self._ns

    def add(self, *events: Any) -> None:
        """Append events."""
        for event in events:
            self.journal.append(event)

    def did(self, step: str, result: Any = None) -> None:
        """Append a whole step."""
        self.add(StepStarted(step, 1, False, "test"), StepEnded(step, 1, Outcome.DONE, result))

    def measured(self, index: int) -> None:
        """Append the step of one point, with its row."""
        step = f"points[{index}].measure"
        self.add(StepStarted(step, 1, True, "test.double"))
        self.add(Recorded("doubled", {"value": 2 * index}, step, 1, 1, True))
        self.add(StepEnded(step, 1, Outcome.DONE, {"value": 2 * index}))

    def say(self, text: str) -> None:
        """Append a line for the operator."""
        self.add(Said(text))

    def paused_by(self, operator: str) -> None:
        """Append a pause."""
        self.add(OperatorAction("pause", operator, host="cell-pc", via="cli"))
        self.add(StateChanged("running", "paused", "by the operator"))

    def judged(self, sentence: str) -> None:
        """Append a verdict."""
        self.add(Recorded("verdict", {"verdict": "better", "sentence": sentence}))

    def end(self, state: str = "finished") -> None:
        """Append the end, and end the process that writes."""
        self.add(StateChanged("running", "cleaning"), StateChanged("cleaning", state), RunEnded(state))
        self.journal.close()

    def reopen(self) -> None:
        """Write on as another process would that resumes the run."""
        self.journal = Journal.reopen(self.folder, self._now_ns)

    @contextmanager
    def unsafe(self) -> Iterator[None]:
        """Inside this context the events are written together: thousands of them in a second."""
        self.journal._connection.execute("PRAGMA synchronous = OFF")
        self.journal._connection.execute("BEGIN")
        yield
        self.journal._connection.execute("COMMIT")


class Running:
    """A campaign that runs in a thread, as another process would run it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.gate = folder, FakeGate("gate")
        self.outcome: Any = None
        self.thread = threading.Thread(target=lambda: asyncio.run(self.run()), daemon=True)
        self.thread.start()

    async def run(self) -> None:
        clock = WallClock()
        procedure = read_procedure(parse_yaml(TEXT, "test.yaml"))
        surround = Surround(clock, 1, self.folder, parse_yaml("name: x", "c.yaml"), self.folder, {"gate": self.gate})
        with Journal.create(self.folder, clock.now_ns) as journal:
            source = SourceFile("test.yaml", TEXT, sha256_of(TEXT))
            started = journal.append(RunStarted(source, source, {}, 1, "realtime", "me", "now", "", {}))
            plan = Plan(procedure, {}, StepRegistry(KINDS), {"gate": self.gate})
            self.outcome = await Engine(plan, surround, journal, Mailbox(), None, fold([started])).run()

    def events(self, kind: type) -> list[Any]:
        return [entry.event for entry in read_journal(self.folder) if isinstance(entry.event, kind)]
