"""Operators' actions and broken interlocks: they pause, continue or end a run."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import final

from cellctl.clock import calendar_time
from cellctl.devices import DeviceError
from cellctl.engine.interlocks import Interlocks
from cellctl.engine.mailbox import Action, Mailbox, Operator
from cellctl.engine.outcome import Aborted, AbortedByInterlock
from cellctl.engine.recorder import Recorder
from cellctl.journal import InterlockChanged, OperatorAction
from cellctl.procedure import Interlock, OnBreak, Resume

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
