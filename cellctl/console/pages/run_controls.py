"""Buttons of a run: pause, continue, confirm, reset, abort, retry. Each is enabled only where it applies."""

from __future__ import annotations

import asyncio
from typing import final
from urllib.parse import quote

from nicegui import ui

from cellctl.console import commands
from cellctl.console.live import Snapshot
from cellctl.console.look import command_button, link_button
from cellctl.console.page_commands import Commands, answer_of, enable
from cellctl.console.run_sentence import is_pausing
from cellctl.engine import ActionName, Operator
from cellctl.journal import JournalError
from cellctl.operations.detached import question_of

_NO_SAFETY_STOP = (
    "This is no safety stop: the step in progress is cancelled, the robot brakes, and the clean-up steps follow. "
    "In danger press the emergency stop of the cell."
)


@final
class RunControls:
    """The buttons of one run, and the text that waits to be confirmed."""

    def __init__(self, snapshot: Snapshot) -> None:
        self._run, self._folder = snapshot.run, snapshot.folder
        self._asked = ("", "")
        self._panel = ui.element("div").classes("confirm-panel").props("role=alert")
        self._panel.set_visibility(False)
        with ui.element("div").classes("row"):
            self._pause = command_button("Pause", lambda: self._act("pause"), icon="pause")
            self._resume = command_button("Continue", lambda: self._act("resume"), icon="play_arrow")
            self._reset = command_button("Reset the simulated cell", lambda: self._act("reset"), icon="restart_alt")
            self._abort = command_button("Abort …", self._on_abort, icon="stop", dangerous=True)
            self._retry = command_button("Retry …", self._on_retry, icon="replay")
            self._result = link_button("Result and report", f"/run/{quote(self._run)}/result", icon="description")
        self._commands = Commands()

    def show(self, now: Snapshot) -> None:
        """Enable what applies now."""
        status, active = now.status, now.active
        pausing = is_pausing(now)
        ending = status.state == "cleaning"
        self._ask(*((status.step, status.confirm) if status.confirm and active else ("", "")))
        enable(self._pause, active and not ending and not pausing and status.state != "paused")
        enable(self._resume, active and (pausing or status.state == "paused"))
        self._reset.set_visibility(active and bool(status.broken) and is_simulated(now))
        enable(self._abort, active and not ending)
        enable(self._retry, can_retry(now))
        self._retry.set_visibility(can_retry(now))
        self._result.set_visibility(now.ended)

    async def _act(self, name: ActionName, text: str = "") -> None:
        await self._commands.give(lambda operator: commands.act_on(operator, self._folder, name, text))

    def _ask(self, step: str, text: str) -> None:
        """Show the text to confirm. Each question has a button of its own: a late click confirms no other step."""
        if (step, text) == self._asked:
            return
        self._asked = step, text
        self._panel.clear()
        self._panel.set_visibility(bool(step))
        if not step:
            return
        with self._panel:
            ui.label("Confirm before the run goes on").classes("section-title")
            ui.label(text).classes("confirm-text")
            command_button("Confirm", lambda: self._act("confirm", step), icon="check", important=True)

    async def _on_abort(self) -> None:
        with ui.dialog() as dialog, ui.card():
            ui.label(f"Abort {self._run}?").classes("section-title")
            ui.label(_NO_SAFETY_STOP)
            reason = ui.input("Reason, for the record").props("outlined dense").classes("wide")
            with ui.element("div").classes("row"):
                command_button("Abort the run", lambda: dialog.submit(True), dangerous=True)
                command_button("Let it run", lambda: dialog.submit(False))
        if await answer_of(dialog):
            await self._act("abort", reason.value.strip()[:500])

    async def _on_retry(self) -> None:
        try:
            question = await asyncio.to_thread(question_of, self._folder)
        except JournalError as error:
            self._commands.refuse(error)
            return
        with ui.dialog() as dialog, ui.card():
            ui.label(f"Continue {self._run} at the step that it did not finish?").classes("section-title")
            ui.label("Finished steps are not repeated. The robot of a real cell will move.")
            go = command_button("Continue the run", lambda: dialog.submit(True), important=True)
            if question:
                ui.label(f"{question[0].upper()}{question[1:]}.").classes("confirm-text")
                looked = ui.checkbox("I have looked at the cell: the robot is clear, and is where it was.")
                looked.on_value_change(lambda event: enable(go, bool(event.value)))
                enable(go, False)
            with ui.element("div").classes("row") as row:
                command_button("Cancel", lambda: dialog.submit(False))
            go.move(row, 0)
        if await answer_of(dialog):
            await self._commands.give(lambda operator: self._resume_run(operator, acknowledged=bool(question)))

    async def _resume_run(self, operator: Operator, *, acknowledged: bool) -> None:
        ui.notify("Continuing: the run checks again, and connects to its devices …")
        await commands.retry(operator, self._folder, acknowledged=acknowledged)


def is_simulated(now: Snapshot) -> bool:
    """Whether simulators answered for the devices of the run."""
    return any(identity["simulated"] for identity in now.state.identities.values())


def can_retry(now: Snapshot) -> bool:
    """Whether the run ended early, so that it can be continued at the step that it did not finish."""
    return not now.writing and now.state.started is not None and now.state.state != "finished"
