"""Interlocks, and operators' actions: they pause, continue or end a run. Interlocks are level-triggered.

They are a convenience and give no protection to persons: that is the safety controller's task.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from typing import cast, final

from cellctl.clock import Clock, calendar_time
from cellctl.devices import Conditions, Device, DeviceError
from cellctl.engine._mailbox import Action, Mailbox, Operator
from cellctl.engine._recorder import Recorder
from cellctl.engine._states import Aborted, AbortedByInterlock
from cellctl.files import InputError
from cellctl.journal import InterlockChanged, OperatorAction
from cellctl.procedure import Interlock, OnBreak, Procedure, Resume

_LOOK_EVERY_S = 0.1
"""Longest delay until a break is detected while a step runs, in the cell's time."""

NOTICED_AFTER_S = 0.3
"""Three polls of a PLC, in the cell's time."""

_ANSWER_S = 2.0
"""In the cell's time: if a device does not answer within this limit, its condition counts as broken."""

_READY = "ready"
"""The condition of a robot that no message stops; after the safety chain stopped it, a person acknowledges one."""

_TO_ACKNOWLEDGE = (
    "a message stops it: acknowledge it at its pendant, after the reset of the cell (in a simulated cell: `cellctl "
    "acknowledge`)"
)


class StoppedByInterlock(Exception):
    """An interlock cancelled the step; it is repeated when the run continues."""


@final
class Interlocks:
    """The interlocks of a run. `broken`: the broken ones, each with its text.

    `changed(interlock, holds, text)` is called at each change.
    """

    def __init__(
        self,
        procedure: Procedure,
        devices: Mapping[str, Device],
        clock: Clock,
        changed: Callable[[Interlock, bool, str], object],
    ) -> None:
        self.broken: dict[Interlock, str] = {}
        self._procedure, self._devices, self._clock, self._changed = procedure, devices, clock, changed
        self._awaited: dict[str, Interlock] = {}
        self._step: asyncio.Timeout | None = None

    @property
    def awaits_only_a_person(self) -> bool:
        """Whether nothing is broken but messages of robots that somebody has to acknowledge."""
        return all(interlock in self._awaited.values() for interlock in self.broken)

    def install(self) -> None:
        """Raises InputError if the device does not have the condition."""
        problems = []
        for interlock in self._procedure.interlocks:
            device = self._devices.get(interlock.device)
            if not isinstance(device, Conditions) or interlock.condition not in device.conditions():
                what = f"'{interlock.device}' has no condition '{interlock.condition}'"
                at = (*interlock.at, "condition")
                problems.append(self._procedure.document.problem(at, what, "`cellctl check` names those it has"))
        if problems:
            raise InputError(problems)

    async def look(self) -> None:
        """Check all conditions now. What breaks one may stop a robot by a message: it is awaited ready, too."""
        for interlock in self._procedure.interlocks:
            await self._look_at(interlock)
        if any(interlock in self.broken for interlock in self._procedure.interlocks):
            self._await_ready()
        for interlock in list(self._awaited.values()):
            await self._look_at(interlock)
        if not self.broken:
            self._awaited.clear()

    def _await_ready(self) -> None:
        """The next step does not begin before every robot is ready to move."""
        for name, device in self._devices.items():
            if name not in self._awaited and isinstance(device, Conditions) and _READY in device.conditions():
                self._awaited[name] = Interlock(f"{name} {_READY}", name, _READY, OnBreak.PAUSE, Resume.AUTO)

    async def _look_at(self, interlock: Interlock) -> None:
        holds, text = await self._answer(interlock)
        if holds is (interlock not in self.broken):
            return
        if holds:
            del self.broken[interlock]
        else:
            self.broken[interlock] = text
        self._changed(interlock, holds, text)

    async def watch(self) -> None:
        """Check all conditions periodically, until cancelled."""
        while self._procedure.interlocks:
            await self._clock.sleep(_LOOK_EVERY_S)
            await self.look()

    async def look_after_failure(self) -> bool:
        """A step has failed: check all conditions once their devices had time to notice; whether one stops the steps.

        A robot is stopped by the safety chain itself, before any device reports the chain.
        """
        if not self._procedure.interlocks:
            return False
        await self._clock.sleep(NOTICED_AFTER_S)
        await self.look()
        return any(interlock.on_break is OnBreak.STOP for interlock in self.broken)

    def holding(self) -> str:
        """The first broken interlock that blocks the run, as text; empty if there is none."""
        texts = (text for interlock, text in self.broken.items() if interlock.on_break is not OnBreak.ABORT)
        return next(texts, "")

    def stop_step(self) -> None:
        """Cancel the step in progress, if any."""
        # Between two steps there is none to cancel: the next one is held by `holding`, which is asked without an await
        # before it begins.
        if self._step and not self._step.expired():
            self._step.reschedule(asyncio.get_running_loop().time())

    @asynccontextmanager
    async def stoppable(self) -> AsyncIterator[None]:
        """The body is the step that `stop_step` cancels. Raises StoppedByInterlock then."""
        try:
            async with asyncio.timeout(None) as self._step:
                step = self._step
                try:
                    yield
                finally:
                    self._step = None
        except TimeoutError as error:
            if step.expired():
                raise StoppedByInterlock from error
            raise

    async def _answer(self, interlock: Interlock) -> tuple[bool, str]:
        """Whether the condition holds, and its text; it counts as broken if the device cannot report it."""
        device = cast(Conditions, self._devices[interlock.device])  # `install` has looked: ten times a second is slow
        name = f"interlock '{interlock.id}'"
        text = f"{name}: {interlock.device}: {device.conditions()[interlock.condition]}"
        try:
            async with self._clock.timeout(_ANSWER_S):
                holds = await device.holds(interlock.condition)
        except DeviceError as error:
            if interlock in self._awaited.values():
                return True, ""  # nobody can acknowledge what is lost: the step finds it lost, and fails
            cure = f" ({error.cure})" if error.cure else ""
            return False, f"{name}: {error.device}: {error.what}{cure}"
        except TimeoutError:
            return False, f"{name}: {interlock.device} did not answer within {_ANSWER_S:g} s"
        except Exception as error:  # an error in a driver must not disable an interlock
            return False, f"{name}: {interlock.device} cannot answer: {type(error).__name__}: {error}"
        if not holds and interlock in self._awaited.values():
            return False, f"{interlock.device}: {_TO_ACKNOWLEDGE}"
        return holds, text if holds else f"{name} does not hold ({interlock.device}: {interlock.condition})"


Reset = Callable[[], Awaitable[None]]
"""Presses the reset of a simulated cell. Raises DeviceError."""

BY_OPERATOR = "by the operator"
"""Reason for a pause or resumption that the operator requested."""


@final
class Control:
    """Takes actions, records each with operator and time, and does it or reports why it is refused.

    `aborted`: why the run is aborted, else None. `cancel`: ends the work; None while no work is in progress.
    `ending`: the steps are over and the run cleans up; it accepts no further action. `reset`: of a simulated cell.
    """

    def __init__(self, mailbox: Mailbox, recorder: Recorder, reset: Reset | None = None) -> None:
        self.aborted: Aborted | None = None
        self.cancel: Callable[[], object] | None = None
        self.ending = False
        self.interlocks: Interlocks | None = None
        self._mailbox = mailbox
        self._recorder = recorder
        self._reset = reset
        self._resetting: asyncio.Task[None] | None = None
        self._paused = ""
        self._asked: asyncio.Future[Operator] | None = None
        self._asked_step = ""
        self._changed = asyncio.Event()

    def take(self, action: Action) -> None:
        """Record an action and do it, or record why it is refused."""
        refused = self._refusal(action)
        operator, text = action.operator, action.text
        if action.name == "confirm" and not refused:
            text = self._asked_step
        event = OperatorAction(
            action.name,
            operator.name,
            text,
            operator.host,
            operator.via,
            calendar_time(),
            refused=refused,
            id=action.id,
        )
        self._recorder.append(event, final=True)
        if refused:
            if (
                action.name == "resume"
            ):  # whoever acknowledged at the pendant says so: the conditions are looked at again
                self._changed.set()
            return
        match action.name:
            case "pause":
                self._paused = BY_OPERATOR
            case "resume":
                self._paused = ""
            case "abort":
                self.abort(Aborted(text or "aborted by the operator"))
            case "confirm" if self._asked:
                self._asked.set_result(operator)
            case "reset" if self._reset:
                self._resetting = asyncio.create_task(self._press(self._reset), name="reset")
        self._changed.set()

    def abort(self, why: Aborted) -> None:
        """End the work; the first reason stays."""
        self.aborted = self.aborted or why
        if self.cancel:
            self.cancel()

    def held_by(self) -> str:
        """Why the next step cannot begin, as text; empty if it can."""
        return self._broken() or self._paused

    async def change(self) -> None:
        """Wait for an operator's action or a change of an interlock."""
        self._changed.clear()
        await self._changed.wait()

    async def confirmation(self, step: str) -> Operator:
        """Wait until an operator confirms the step at the path `step`; returns the operator."""
        self._asked_step = step
        self._asked = asyncio.get_running_loop().create_future()
        if self._mailbox.confirm_all:
            self.take(Action("confirm", self._mailbox.confirm_all))
        try:
            return await self._asked
        finally:
            self._asked = None

    def interlock_changed(self, interlock: Interlock, holds: bool, text: str) -> None:
        """Record the change; at a break, do what the procedure specifies."""
        self._recorder.append(
            InterlockChanged(interlock.id, interlock.device, interlock.condition, holds, text), final=True
        )
        self._changed.set()
        if holds:
            return
        if interlock.on_break is OnBreak.ABORT:
            self.abort(AbortedByInterlock(f"aborted: {text}"))
            return
        if interlock.resume is Resume.OPERATOR:
            self._paused = self._paused or text
        if interlock.on_break is OnBreak.STOP and self.interlocks:
            self.interlocks.stop_step()

    async def _press(self, press: Reset) -> None:
        try:
            await press()
        except DeviceError as error:
            self._recorder.said("", f"the simulated cell was not reset: {error}")
        self._changed.set()

    def _broken(self) -> str:
        return self.interlocks.holding() if self.interlocks else ""

    def _refusal(self, action: Action) -> str:
        match action.name:
            case _ if self.aborted or self.ending:
                return "the run is ending already"
            case "abort":
                return ""
            case "pause" if self._paused:
                return "the run is paused already"
            case "resume" if broken := self._broken():
                return broken
            case "resume" if not self._paused:
                return "the run is not paused"
            case "confirm" if self._asked is None or self._asked.done():
                return "the run waits for no confirmation"
            case "confirm" if action.text not in ("", self._asked_step):
                return f"the run waits for the confirmation of '{self._asked_step}', not of '{action.text}'"
            case "reset" if self._reset is None:
                return "the cell is real: its reset and its robot's messages are acknowledged there, by a person"
            case "reset" if not self._broken():
                return "the run waits for no reset"
            case _:
                return ""
