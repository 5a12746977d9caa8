"""The dialog that plans a run: when its cell is free, or at a time of day."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from nicegui import ui

from cellctl.console import queue_commands
from cellctl.console.appearance import command_button, why_not
from cellctl.console.frame import answer_of
from cellctl.console.run_queue import Planned
from cellctl.engine import Operator

DAYS = {1: "Mon", 2: "Tue", 3: "Wed", 4: "Thu", 5: "Fri", 6: "Sat", 7: "Sun"}

_FREE, _CLOCK = "when the cell is free", "at a time of day"


@final
@dataclass(frozen=True, slots=True)
class Plan:
    """When a run is to be offered. time: local time of the console's host, `06:00`; empty: when its cell is free."""

    time: str
    weekdays: tuple[int, ...]

    async def give(self, operator: Operator, planned: Planned) -> None:
        """Queue or schedule the run, which was checked. Raises InputError."""
        if self.time:
            await queue_commands.schedule(operator, planned, self.time, self.weekdays, checked=True)
        else:
            await queue_commands.queue(operator, planned, checked=True)


async def asked_plan() -> Plan | None:
    """What a person chooses; None: nothing."""
    with ui.dialog().props('aria-label="Plan this run"') as dialog, ui.card():
        ui.label("Plan this run").classes("section-title")
        ui.label("It is offered on the page Jobs, and starts when a person at the cell confirms within 10 minutes.")
        refused = why_not("schedule")
        when = ui.radio([_FREE] if refused else [_FREE, _CLOCK], value=_FREE).props('aria-label="When"')
        if refused:
            ui.label(f"A schedule {refused}.").classes("note")
        with ui.element("div").classes("section") as clock:
            at = ui.input("Time", value="06:00").props("outlined dense type=time stack-label")
            with ui.element("div").classes("row").props('role=group aria-label="Days"'):
                days = {day: ui.checkbox(name, value=True) for day, name in DAYS.items()}
        clock.bind_visibility_from(when, "value", value=_CLOCK)
        with ui.element("div").classes("row"):
            command_button("Plan", lambda: dialog.submit(True), important=True)
            command_button("Cancel", lambda: dialog.submit(False))
    if not await answer_of(dialog):
        return None
    chosen = tuple(day for day, box in days.items() if box.value)
    return Plan(at.value or "", chosen) if when.value == _CLOCK else Plan("", ())
