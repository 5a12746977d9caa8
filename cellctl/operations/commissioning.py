"""Commissions a cell: the steps of its devices in order, those without motion first; keeps the record of them.

Each call connects to all devices at once. Then it goes on at the first step that is not passed, or whose device or
set-up has changed. A step that fails, or that nobody confirms, ends the call.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Protocol, final

from cellctl.clock import Clock, calendar_time
from cellctl.devices import (
    CellSteps,
    Commissioned,
    CommissioningStep,
    Device,
    DeviceError,
    DeviceUncertain,
    DeviceUnreachable,
    Figure,
    Health,
    Identity,
    Person,
)
from cellctl.devices.cell import Cell, ClockMode
from cellctl.devices.commissioning_record import (
    CellRecord,
    StepRecord,
    identity_digest,
    load_record,
    record_file,
    save_record,
    setup_digest,
)
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError
from cellctl.formats import RobotFile
from cellctl.installed import contributions
from cellctl.operations.cell_devices import (
    DeviceLocks,
    SimulatedCell,
    open_devices,
    powered,
    require_cells,
    tell_targets,
)

GROUP = "cellctl.commissioning"
"""The entry point group: name = any, value = a `CellSteps`."""

_CONNECTION = "connection"
"""The step that each device has: it runs in each call."""

_ANSWER_S = 30.0
"""Longest wait for a device to connect, in the cell's time."""

_LOOKS = 40
"""Health is read as often."""
_WAITS_S = tuple(0.01 + 0.02 * (look * 0.618 % 1.0) for look in range(_LOOKS))
"""Waits after each look, all different: answers lie on the grid of an adapter's polls, and equal waits would begin
every look at the same place of it."""

_STOP_S = 15.0
"""Longest wait for a device to confirm its stop, as in the clean-up of the shipped procedures."""


@final
@dataclass(frozen=True, slots=True)
class Confirmation:
    """Who confirms a step, and how: `terminal`, `--yes`."""

    name: str
    via: str


class Attendant(Protocol):
    """Shows the steps to a person at the cell, and passes on what that person says."""

    async def confirmed(self, step: StepRecord, number: int, count: int) -> Confirmation | None:
        """Who confirms that this step begins; None: nobody, the sequence ends here."""

    async def asked(self, text: str) -> None:
        """Ask for something to be done, and wait until it is."""

    def told(self, text: str) -> None:
        """Ask for something to be done; the device will show that it is."""

    def ended(self, step: StepRecord) -> None:
        """A step has ended."""


@final
@dataclass(frozen=True)
class CommissionedCell:
    """The record as it is now, its file, and the error that ended the last step; None without one."""

    record: CellRecord
    file: Path
    error: DeviceError | InputError | None = None


async def commission(
    cell: Cell,
    drivers: DriverRegistry,
    attendant: Attendant,
    *,
    seed: int | None = None,
    clock: ClockMode | None = None,
    motion: bool = True,
) -> CommissionedCell:
    """Run the steps that are due, and keep each result in the record beside the cell file as it comes.

    seed, clock: for the simulators of a simulated cell. motion: False ends before the first step that moves.

    Raises InputError if the record is damaged, the simulators refuse the cell file, or the robot has a prismatic joint;
    OSError if the record cannot be written, DeviceBusy before anything connects.
    """
    require_cells()
    RobotFile.load(cell.robot_file).refuse_prismatic(str(cell.robot_file), "a commissioning")
    file = record_file(cell.path)
    kept = load_record(file, cell.name, simulated=cell.simulated)
    with DeviceLocks.held(cell, drivers) as locks:
        async with powered(cell, seed=seed, clock=clock) as (simulated, time):
            devices = open_devices(cell, drivers, time, simulated)
            sequence = _Sequence(cell, drivers, attendant, file, devices, simulated, time, locks)
            try:
                return await sequence.run(kept, motion=motion)
            finally:
                for device in devices.values():
                    await device.close()


@final
@dataclass(frozen=True, slots=True)
class _AtTheCell:
    """The person at the cell; at a simulated cell the simulators do what is asked."""

    attendant: Attendant
    simulated: SimulatedCell | None

    async def asked(self, text: str, device: str, action: str) -> None:
        if self.simulated:
            await self.told(text, device, action)
        else:
            await self.attendant.asked(text)

    async def told(self, text: str, device: str, action: str) -> None:
        self.attendant.told(text)
        if self.simulated and action == "reset":
            await self.simulated.reset()
        elif self.simulated:
            await self.simulated.tell({"op": "by_hand", "device": device, "action": action})


@final
class _Sequence:
    def __init__(
        self,
        cell: Cell,
        drivers: DriverRegistry,
        attendant: Attendant,
        file: Path,
        devices: Mapping[str, Device],
        simulated: SimulatedCell | None,
        clock: Clock,
        locks: DeviceLocks,
    ) -> None:
        self._cell, self._drivers, self._attendant, self._file = cell, drivers, attendant, file
        self._devices, self._simulated, self._clock, self._locks = devices, simulated, clock, locks
        self._identities: dict[str, Identity] = {}
        self._unreachable: dict[str, DeviceError] = {}
        self._error: DeviceError | InputError | None = None

    async def run(self, kept: CellRecord | None, *, motion: bool) -> CommissionedCell:
        steps = [(name, self._connection(name)) for name in self._devices] + self._contributed()
        self._record = CellRecord(self._cell.name, self._cell.simulated, steps=tuple(_due(*each) for each in steps))
        self._take_over(kept)
        await asyncio.gather(*map(self._connect, self._devices))
        for number, (device, step) in enumerate(steps, 1):
            one = self._record.step(_id(device, step.id))
            assert one is not None
            if step.id != _CONNECTION and one.state == "passed" and one.identity == self._identity_of(device):
                continue
            if step.moves and not motion:
                break
            who = await self._attendant.confirmed(one, number, len(steps))
            if who is None:
                self._ended(replace(one, state="declined", at=calendar_time()))
                break
            if (await self._carry_out(device, step, one, who)).state != "passed":
                break
        return CommissionedCell(self._record, self._file, self._error)

    def _contributed(self) -> list[tuple[str, CommissioningStep]]:
        """The steps of the devices and of the cell, those that move last."""
        found = [
            (name, step)
            for name, device in self._devices.items()
            if isinstance(device, Commissioned)
            for step in device.commissioning()
        ]
        broken: list[str] = []
        for _, each in contributions(GROUP, CellSteps, "commissioning", broken):
            steps = each.of(self._cell.document, self._cell.robot_file, self._devices, self._clock)
            found += [("", step) for step in steps]
        for text in broken:
            logging.getLogger(__name__).warning(text)
        return sorted(found, key=lambda each: each[1].moves)

    def _take_over(self, kept: CellRecord | None) -> None:
        """The results that are bound to the set-up as it is now."""
        for step in self._record.steps:
            earlier = kept.step(step.id) if kept else None
            setup = setup_digest(self._cell, self._drivers, step.device)
            if earlier and earlier.setup == setup:
                result = replace(
                    earlier, title=step.title, does=step.does, next_needs=step.next_needs, moves=step.moves
                )
                self._record = self._record.with_step(result)

    async def _carry_out(self, device: str, step: CommissioningStep, one: StepRecord, who: Confirmation) -> StepRecord:
        person = _AtTheCell(self._attendant, self._simulated)
        begun = replace(one, state="failed", figures=(), what="", cure="", confirmed_by=who.name, via=who.via)
        try:
            figures = tuple(await step.run(person))
            passed = all(figure.ok for figure in figures)
            ended = replace(begun, figures=figures, state="passed" if passed else "failed")
        except (DeviceError, InputError) as error:
            self._error = await self._uncertain(_what(error)) or error if step.moves else error
            ended = replace(begun, what=_what(self._error), cure=getattr(self._error, "cure", ""))
        except asyncio.CancelledError:
            uncertain = await self._uncertain("interrupted") if step.moves else None
            self._ended(replace(begun, what=uncertain.what if uncertain else "was interrupted", at=calendar_time()))
            if uncertain:
                raise uncertain from None
            raise
        setup = setup_digest(self._cell, self._drivers, device)
        ended = replace(ended, at=calendar_time(), setup=setup, identity=self._identity_of(device))
        self._ended(ended)
        return ended

    async def _uncertain(self, cause: str) -> DeviceUncertain | None:
        """Stop every device after a step that moves has failed; the error of one that does not confirm it."""
        for device in self._devices.values():
            try:
                async with self._clock.timeout(_STOP_S):
                    await device.stop()
            except (DeviceError, TimeoutError) as error:
                what = f"has not confirmed its stop ({_what(error) or 'no answer'}), after: {cause}"
                return DeviceUncertain(device.name, what, "keep away from the cell; look at it before anything else")
        return None

    def _ended(self, step: StepRecord) -> None:
        self._record = self._record.with_step(step)
        save_record(self._file, self._record)
        self._attendant.ended(step)

    def _identity_of(self, device: str) -> str:
        met = self._identities
        return identity_digest([met[device]] if device in met else [] if device else met.values())

    async def _connect(self, name: str) -> None:
        """Connect; the error is that of the device's first step. All at once: the simulators write from their start,
        and a serial port that is opened later has lost what came before.
        """
        device = self._devices[name]
        try:
            async with self._clock.timeout(_ANSWER_S):
                identity = await device.connect()
                self._locks.meet(identity)
                await tell_targets(self._simulated, {name: device}, self._clock)
            self._identities[name] = identity
        except TimeoutError:
            self._unreachable[name] = _unanswered(name)
        except DeviceError as error:
            self._unreachable[name] = error

    async def _meet(self, name: str, _: Person) -> list[Figure]:
        """The identity, and the health of a connected device. Raises the driver's error."""
        if error := self._unreachable.get(name):
            raise error
        device, identity, looks = self._devices[name], self._identities[name], []
        try:
            async with self._clock.timeout(_ANSWER_S):
                for wait_s in _WAITS_S:
                    looks.append(await device.health())
                    await self._clock.sleep(wait_s)
        except TimeoutError:
            raise _unanswered(name) from None
        return [
            Figure("model", "model", identity.model),
            Figure("serial", "serial number", identity.serial),
            Figure("firmware", "version", identity.firmware),
            *_latencies(looks),
            *_health(looks[-1]),
        ]

    def _connection(self, name: str) -> CommissioningStep:
        address = self._cell.document.data["devices"][name]
        return CommissioningStep(
            _CONNECTION,
            f"connection to {name}",
            f"Connection to {address}: cables, identity, version, health. Nothing moves.",
            "the device is the one that the cell file means",
            partial(self._meet, name),
        )


def _unanswered(name: str) -> DeviceUnreachable:
    return DeviceUnreachable(name, f"did not answer within {_ANSWER_S:g} s", "is it switched on?")


def _latencies(looks: Sequence[Health]) -> list[Figure]:
    """Of a device whose looks at the health are requests; the spread is that of nine in ten."""
    found = sorted(look.figures["latency_ms"] for look in looks if "latency_ms" in look.figures)
    if not found:
        return []
    cut = len(found) // 20
    return [
        Figure("latency_ms", "answer after a request, median", median(found), "ms"),
        Figure("latency_least_ms", "the same, shortest", found[0], "ms"),
        Figure("latency_most_ms", "the same, longest", found[-1], "ms"),
        Figure("latency_spread_ms", "the same, spread of nine in ten", found[-1 - cut] - found[cut], "ms"),
    ]


def _health(look: Health) -> list[Figure]:
    """A robot in T1 is in order here, as a campaign is not what follows."""
    in_order = look.ok or look.mode == "T1"
    return [
        Figure("health", "health", look.text),
        Figure("in_order", "in order", "yes" if in_order else "no", wanted="yes"),
    ]


def _due(device: str, step: CommissioningStep) -> StepRecord:
    return StepRecord(_id(device, step.id), device, step.title, step.does, step.next_needs, step.moves)


def _id(device: str, step: str) -> str:
    return f"{device or 'cell'}.{step}"


def _what(error: Exception) -> str:
    return error.what if isinstance(error, DeviceError) else str(error)
