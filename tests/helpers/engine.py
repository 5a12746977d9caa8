"""A family of small steps, fake devices, and an engine that runs a procedure of them."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cellctl.clock import WallClock
from cellctl.devices import DeviceLost, DeviceUncertain, DeviceUnreachable, Health, Identity, MovingRobot, NoContact
from cellctl.engine import Engine, Mailbox, Plan, Surround
from cellctl.engine.status import KnownProcedure
from cellctl.files import parse_yaml
from cellctl.journal import Journal, RunStarted, SourceFile, read_journal
from cellctl.procedure import NoInputs, StepContext, StepInputs, StepRegistry, StepResult, read_procedure, step
from cellctl.records import Row

CALLS: list[str] = []


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
