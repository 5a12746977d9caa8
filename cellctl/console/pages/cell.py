"""`/cell`: health of each device, emergency stop, guard, operating mode; `doctor`."""

from __future__ import annotations

import asyncio
from datetime import datetime
from pathlib import Path
from typing import final
from urllib.parse import quote

from fastapi import Request
from nicegui import ui

from cellctl.clock import calendar_time
from cellctl.console import commands
from cellctl.console.appearance import (
    State,
    StateWord,
    command_button,
    link_button,
    problem_list,
    section,
    shown_time,
    state_word,
)
from cellctl.console.frame import Commands, enable, follow, follow_event, frame, set_text
from cellctl.console.shared import console
from cellctl.devices.cell import Cell
from cellctl.engine import Operator
from cellctl.files import InputError
from cellctl.journal import RunState
from cellctl.operations.cell_state import CellState, DeviceState, cell_state, is_on, last_examination, last_run_on
from cellctl.operations.checking import FileChoice, choices
from cellctl.operations.doctor import Examination

_DEVICE: dict[str, State] = {"in order": "good", "failed": "bad", "not known": "unknown"}
_CHAIN: dict[str, State] = {"closed": "good", "open": "bad", "not known": "unknown"}
_LATENCY = "Latency, ms"
_COLUMNS = ("Device", "State", _LATENCY, "Reported health", "Identity", "Last error")
_SOURCES = (
    "As the devices reported to this computer. Nobody is protected by it: look at the cell before you enter it. "
    "The console never connects to a device by itself."
)


@ui.page("/cell", response_timeout=30.0)
async def cell(request: Request, name: str = "") -> None:
    """The cell of this name; default: the console's, else the first one."""
    found = await asyncio.to_thread(choices, "cell", console().settings.cell)
    given = console().settings.cell
    chosen = found.get(name) or found[given.stem if given else next(iter(found))]
    with frame("Cell", "/cell"):
        _choice(found, chosen)
        try:
            loaded = await commands.loaded_cell(chosen.file)
        except InputError as error:
            problem_list(error.problems)
            return
        page = _CellPage(loaded, chosen.file)
        await page.show_latest()
        follow(page.show)
        follow_event(page.show_latest, lambda changed: commands.examinations.add(changed, str(chosen.file)), "a cell")


def _choice(found: dict[str, FileChoice], chosen: FileChoice) -> None:
    names = {name: f"{one.title} ({name})" for name, one in found.items()}
    with ui.element("div").classes("row"):
        ui.select(
            names,
            value=chosen.name,
            label="Cell",
            with_input=True,
            on_change=lambda event: ui.navigate.to(f"/cell?name={event.value}") if event.value else None,
        ).props("outlined dense options-dense").style("min-width: 22rem")
        kind = "Simulated devices" if chosen.simulated else "Real devices"
        ui.label(kind).classes("note")
        ui.label(str(chosen.file)).classes("note mono")


@final
class _CellPage:
    def __init__(self, cell: Cell, file: Path) -> None:
        self._cell, self._file = cell, file
        self._doctor: Examination | None = None
        self._last: tuple[str, RunState] | None = None
        with ui.element("div").classes("row"):
            self._examine = command_button(
                "Examine devices", self._on_examine, icon="troubleshoot", important=True, gives="doctor"
            )
            self._working = ui.label("Connecting to each device …").props("role=status")
            self._run = link_button("Open the run", "/run")
        self._commands = Commands()
        with section("Safety inputs", note=_SOURCES), ui.element("div").classes("tiles"):
            self._safety = {name: _tile(name) for name in ("Emergency stop", "Guard", "Operating mode")}
        with section("Devices"):
            self._source = ui.label().classes("note")
            with ui.element("div").classes("scrolling"), ui.element("table").classes("figures devices"):
                with ui.element("thead"), ui.element("tr"):
                    for title in _COLUMNS:
                        with ui.element("th").classes("words" * (title != _LATENCY)).props("scope=col"):
                            ui.label(title)
                with ui.element("tbody"):
                    self._rows = {device: _DeviceRow() for device in cell.addresses}
        self._set_working(commands.being_examined(file))

    async def show_latest(self) -> None:
        """Read the last examination and the last run, and show the cell."""
        self._doctor = await asyncio.to_thread(last_examination, self._cell, console().runs)
        self._last = await asyncio.to_thread(last_run_on, self._cell, console().runs)
        self.show()

    def show(self) -> None:
        """Show what the active run reported, else the last run or the last examination."""
        active = self._active()
        self._last = active or self._last
        state = cell_state(self._cell, self._last, self._doctor, active=bool(active))
        for name, (word, value) in _safety_of(state).items():
            self._safety[name].show(word, value)
        for device in state.devices:
            self._rows[device.name].show(device)
        set_text(self._source, _source(state))
        self._run.set_visibility(bool(state.run))
        self._run.props["href"] = f"/run/{quote(state.run, safe='')}"
        working = commands.being_examined(self._file)
        self._set_working(working)
        enable(self._examine, not working and not state.run)

    def _active(self) -> tuple[str, RunState] | None:
        live = console().live
        for name in live.active:
            state = live.run(name).snapshot.state
            if is_on(state, self._cell.document.text):
                return name, state
        return None

    async def _on_examine(self) -> None:
        async def work(operator: Operator) -> None:
            await commands.examine(operator, self._file)

        await self._commands.give(work)

    def _set_working(self, working: bool) -> None:
        self._working.set_visibility(working)


@final
class _DeviceRow:
    def __init__(self) -> None:
        with ui.element("tr"):
            with ui.element("th").classes("words").props("scope=row"):
                self._name = ui.label()
                self._address = ui.label().classes("note mono address")
            with ui.element("td").classes("words"):
                self._state = state_word("unknown", "not known")
            with ui.element("td"):
                self._latency = ui.label()
            with ui.element("td").classes("words"):
                self._text = ui.label()
            with ui.element("td").classes("words"):
                self._model = ui.label()
                self._serial = ui.label().classes("note")
            with ui.element("td").classes("words"):
                self._error = ui.label()
                self._cure = ui.label().classes("note")

    def show(self, device: DeviceState) -> None:
        serial = ", ".join(filter(None, (f"serial {device.serial}" if device.serial else "", device.firmware)))
        set_text(self._name, device.name)
        set_text(self._address, device.address.partition("?")[0])
        self._state.show(_DEVICE[device.state], device.state)
        set_text(self._latency, "–" if device.latency_ms is None else f"{device.latency_ms:.1f}")
        set_text(self._text, device.text or "–")
        set_text(self._model, device.model or "–")
        set_text(self._serial, serial)
        set_text(self._error, device.last_error or "none")
        set_text(self._cure, device.cure)


def _tile(name: str) -> StateWord:
    with ui.element("div").classes("tile"):
        ui.label(name).classes("note")
        return state_word("unknown", "not known", large=True)


def _safety_of(state: CellState) -> dict[str, tuple[State, str]]:
    unknown = state.mode == "not known"
    return {
        "Emergency stop": (
            _CHAIN[state.emergency_stop],
            _chain(state.emergency_stop, "not pressed", "pressed, or broken"),
        ),
        "Guard": (_CHAIN[state.guard], _chain(state.guard, "closed", "open")),
        "Operating mode": ("unknown" if unknown else "working", state.mode),
    }


def _chain(state: str, closed: str, opened: str) -> str:
    return {"closed": closed, "open": opened}.get(state, state)


def _source(state: CellState) -> str:
    if state.run:
        return (
            f"From run {state.run}, begun {shown_time(state.at)}: health and latency as of its connection to the "
            "devices, inputs as of the last border between two steps."
        )
    if state.source == "doctor":
        return f"From the last examination (doctor), {shown_time(state.at)}, {_age(state.at)} ago. {_NOW_UNKNOWN}"
    if state.source:
        when = f"{shown_time(state.at)}, {_age(state.at)} ago"
        return f"As the last run on this cell, {state.source}, saw it at its end, {when}. {_NOW_UNKNOWN}"
    return "Not examined yet, and no run was on this cell."


_NOW_UNKNOWN = "Its present state is known after an examination."


def _age(utc: str) -> str:
    """`5 min`, as of now."""
    minutes = round((datetime.fromisoformat(calendar_time()) - datetime.fromisoformat(utc)).total_seconds() / 60.0)
    if minutes < 120:
        return f"{minutes} min"
    return f"{minutes // 60} h" if minutes < 48 * 60 else f"{minutes // 1440} days"
