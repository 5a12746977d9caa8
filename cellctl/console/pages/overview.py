"""`/overview`: all cells at a glance."""

from __future__ import annotations

import asyncio
from typing import final
from urllib.parse import quote

from nicegui import ui

from cellctl.console import commands
from cellctl.console.appearance import about, look_of_verdict, section, shown_time, state_word
from cellctl.console.frame import ALARMS, follow, follow_event, frame, set_text
from cellctl.console.overview import CellOverview
from cellctl.console.shared import console

_EVERY_S = 1.0
"""Wall time between two looks at all cells while runs change."""

_COLUMNS = ("Cell", "Devices", "State", "Run", "Progress", "Last verdict", "Calibrated", "Alarms")
_NOTE = (
    "A cell is commanded from its own host alone. Runs of other hosts in this folder are shown; the console on that "
    "host acts on them."
)


@ui.page("/overview", response_timeout=30.0)
async def overview() -> None:
    """All cells that this console knows."""
    with frame("Overview", "/overview"):
        page = _Overview()
        await page.show()
        follow(page.show_later)
        follow_event(page.show, console().watch.subscribe, "the overview")


@final
class _Overview:
    def __init__(self) -> None:
        self._rows: list[_Row] = []
        with section("Cells", note=_NOTE):
            self._count = ui.label().classes("note").props("role=status")
            region = ui.element("div").classes("scrolling").props('tabindex=0 role=region aria-label="Cells"')
            with region, ui.element("table").classes("figures overview"):
                with ui.element("thead"), ui.element("tr"):
                    for title in _COLUMNS:
                        with ui.element("th").classes("words").props("scope=col"):
                            ui.label(title)
                self._body = ui.element("tbody")

    async def show_later(self) -> None:
        """Show the cells, and take no notice of changes for a while: runs change twenty times a second."""
        await self.show()
        await asyncio.sleep(_EVERY_S)

    async def show(self) -> None:
        """Show the cells."""
        found = await commands.cells_overview()
        with self._body:
            self._rows += [_Row() for _ in found[len(self._rows) :]]
        for number, row in enumerate(self._rows):
            row.show(found[number] if number < len(found) else None)
        running = sum(bool(each.run) for each in found)
        reading = ", reading the runs …" if console().live.reading else ""
        set_text(self._count, f"{len(found)} cells, {running} with a run in progress{reading}")


@final
class _Row:
    def __init__(self) -> None:
        with ui.element("tr") as self._row:
            with ui.element("th").classes("words").props("scope=row"):
                self._name = ui.link("", "/cell")
                self._title = ui.label().classes("note")
            with ui.element("td").classes("words"):
                self._kind = state_word("unknown", "")
                self._host = ui.label().classes("note")
            with ui.element("td").classes("words"):
                self._state = state_word("unknown", "")
            with ui.element("td").classes("words"):
                self._run = ui.link("", "/run")
                self._began = ui.label().classes("note")
            with ui.element("td").classes("words"):
                self._progress = ui.label()
                self._left = ui.label().classes("note")
            with ui.element("td").classes("words"):
                self._verdict = state_word("unknown", "")
            with ui.element("td").classes("words"):
                self._calibrated = state_word("unknown", "")
            with ui.element("td").classes("words"):
                self._alarms = ui.link("", ALARMS)

    def show(self, cell: CellOverview | None) -> None:
        self._row.set_visibility(cell is not None)
        if cell is None:
            return
        run = cell.run or cell.last_run
        at_run = f"/run/{quote(run, safe='')}{'' if cell.run else '/result'}"
        _set_link(self._name, cell.name, f"/cell?name={quote(cell.name, safe='')}" if cell.offered else at_run)
        set_text(self._title, cell.title)
        kinds = {True: ("off", "SIMULATED"), False: ("warning", "REAL"), None: ("unknown", "not readable")}
        self._kind.show(*kinds[cell.simulated])  # type: ignore[arg-type]
        set_text(self._host, f"on {cell.host}" if cell.host else "")
        if cell.waits_for:
            self._state.show("waiting", f"waits: {cell.waits_for}")
        else:
            self._state.show("working" if cell.run else "off", cell.state or "no run in progress")
        _set_link(self._run, run, at_run)
        self._run.set_visibility(bool(run))
        set_text(self._began, shown_time(cell.last_began) if cell.last_began else "")
        share = f", {100 * cell.done // cell.total} %" if cell.total else ""
        set_text(self._progress, f"{cell.done} of {cell.total or '?'} steps{share}" if cell.run else "–")
        set_text(self._left, f"{about(cell.left_s)} left" if cell.run and cell.left_s is not None else cell.phase)
        if cell.last_verdict:
            self._verdict.show(look_of_verdict(cell.last_verdict), cell.last_verdict)
        else:
            self._verdict.show("off", cell.last_state if cell.last_run and not cell.run else "none")
        self._calibrated.show("bad" if cell.due else "good" if cell.age_days is not None else "off", _age(cell))
        _set_link(self._alarms, f"{cell.alarms} standing" if cell.alarms else "none", ALARMS)


def _age(cell: CellOverview) -> str:
    if cell.age_days is None:
        return "not in these runs"
    age = f"{cell.age_days:.0f} days ago" if cell.age_days >= 2 else f"{24 * cell.age_days:.0f} h ago"
    return f"{age}: due" if cell.due else age


def _set_link(link: ui.link, text: str, target: str) -> None:
    """Change text and target of a link; unchanged ones send nothing."""
    if link.text != text:
        link.set_text(text)
    if link.props["href"] != target:
        link.props["href"] = target
        link.update()
