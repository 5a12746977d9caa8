"""`/alarms`: what stands, with its acknowledgement, and what has cleared."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final
from urllib.parse import quote

from nicegui import ui

from cellctl.console import commands
from cellctl.console.alarms import KINDS, OVER, Alarm
from cellctl.console.appearance import (
    Cell,
    command_button,
    figures,
    in_page_words,
    section,
    shown_time,
    state_word,
    words,
)
from cellctl.console.frame import ALARMS, Commands, answer_of, follow_event, frame
from cellctl.console.shared import console
from cellctl.engine import Operator

_CLEARED = 200
"""Number of the latest cleared alarms on the page."""

_NOTE = (
    "An alarm of a run or a job that is over clears when it is acknowledged; any other clears when its cause has gone. "
    "No alarm here protects a person."
)


@ui.page("/alarms")
def alarms() -> None:
    """The alarms."""
    with frame("Alarms", ALARMS):
        page = _AlarmsPage()
        follow_event(page.show, console().watch.subscribe, "the alarms")


@final
class _AlarmsPage:
    def __init__(self) -> None:
        self._shown: list[Alarm] | None = None
        self._commands = Commands()
        with section("Standing", note=_NOTE):
            self._standing = ui.element("div").props("aria-live=polite")
        with section("Cleared"):
            self._cleared = ui.element("div")

    def show(self) -> None:
        """Show the alarms, if one has changed."""
        found = console().watch.alarms.all
        if found == self._shown:
            return
        self._shown = found
        stand = [alarm for alarm in found if alarm.stands]
        gone = [alarm for alarm in found if not alarm.stands][:_CLEARED]
        self._standing.clear()
        with self._standing:
            if not stand:
                state_word("good", "No alarm stands.")
            else:
                columns = words("Raised", "Cell", "What", "Cure", "Acknowledged")
                figures(columns, [self._row(alarm) for alarm in stand], label="Standing alarms")
        self._cleared.clear()
        with self._cleared:
            if not gone:
                ui.label("None yet.").classes("note")
                return
            columns = words("Raised", "Cell", "What", "Acknowledged", "Cleared")
            figures(columns, [_past(alarm) for alarm in gone], label="Cleared alarms")

    def _row(self, alarm: Alarm) -> list[Cell]:
        seen: Cell = _seen(alarm) if alarm.acknowledged else lambda: self._button(alarm)
        return [shown_time(alarm.raised), alarm.cell or "–", _what(alarm), _cure(alarm), seen]

    def _button(self, alarm: Alarm) -> None:
        button = command_button("Acknowledge …", lambda: self._ask(alarm), gives="acknowledge")
        button.props(f'aria-label="Acknowledge: {_attribute(alarm.what)}"')

    async def _ask(self, alarm: Alarm) -> None:
        with ui.dialog().props('aria-label="Acknowledge an alarm"') as dialog, ui.card():
            ui.label("Acknowledge this alarm?").classes("section-title")
            ui.label(alarm.what).classes("confirm-text")
            ui.label("It clears with that." if alarm.kind in OVER else "It stands until its cause has gone.")
            said = ui.input("What you found or did, for the record").props("outlined dense autofocus").classes("wide")
            with ui.element("div").classes("row"):
                command_button("Acknowledge", lambda: dialog.submit(True), important=True)
                command_button("Cancel", lambda: dialog.submit(False))
        if await answer_of(dialog):
            text = (said.value or "").strip()[:500]

            async def work(operator: Operator) -> Any:
                return await commands.acknowledge(operator, alarm.id, text)

            await self._commands.give(work)


def _past(alarm: Alarm) -> list[Cell]:
    cleared = f"{shown_time(alarm.cleared)}: {alarm.why}"
    return [shown_time(alarm.raised), alarm.cell or "–", _what(alarm), _seen(alarm), cleared]


def _what(alarm: Alarm) -> Callable[[], None]:
    def draw() -> None:
        with ui.element("div").classes("alarm-words"):
            state_word("bad" if alarm.unseen else "warning" if alarm.stands else "off", KINDS[alarm.kind])
            ui.label(in_page_words(alarm.what))
            if alarm.run:
                ui.link("Open the run", f"/run/{quote(alarm.run)}")

    return draw


def _cure(alarm: Alarm) -> Callable[[], None]:
    def draw() -> None:
        ui.label(in_page_words(alarm.cure) or "–").classes("alarm-words")

    return draw


def _seen(alarm: Alarm) -> str:
    if not alarm.acknowledged:
        return "not acknowledged"
    said = f": {alarm.words}" if alarm.words else ""
    return f"{shown_time(alarm.acknowledged)} by {alarm.by}{said}"


def _attribute(text: str) -> str:
    """A text in a property of an element."""
    return text.replace('"', "'").replace("\n", " ")[:200]
