"""The log of a run, with a filter by kind and text."""

from __future__ import annotations

import asyncio
from typing import final

from nicegui import ui

from cellctl.console.live import LogLine, Snapshot, whole_log
from cellctl.console.look import command_button
from cellctl.console.page_commands import Commands
from cellctl.journal import JournalError

KINDS = {
    "": "all kinds",
    "message": "messages",
    "state": "states",
    "operator": "operators' actions",
    "failure": "failures",
    "interlock": "interlocks",
    "device": "devices",
}
_SHOWN = 300
"""Number of the latest matching lines on the page."""


@final
class RunLog:
    """The latest lines; `show` adds the new ones."""

    def __init__(self, snapshot: Snapshot) -> None:
        self._folder, self._last = snapshot.folder, 0
        self._lines: tuple[LogLine, ...] = ()
        with ui.element("div").classes("row"):
            self._kind = ui.select(KINDS, value="", label="Kind", on_change=lambda: self._refill())
            self._kind.props("outlined dense options-dense").style("min-width: 12rem")
            self._text = ui.input("Text", on_change=lambda: self._refill()).props(
                "outlined dense clearable debounce=200"
            )
            command_button("Search the whole log", self._search_all, icon="manage_search")
            self._found = ui.label().classes("note").props("role=status")
        self._problems = Commands()
        self._log = ui.log(max_lines=_SHOWN).classes("run-log").props('role=log tabindex=0 aria-label="Log of the run"')

    def show(self, now: Snapshot) -> None:
        """Add the lines after the last one."""
        new = [line for line in now.log if line.seq > self._last]
        if now.events < self._last:  # another run in the same folder
            self._log.clear()
            new = list(now.log)
        if not new:
            return
        self._lines, self._last = now.log, new[-1].seq
        self._push(new)

    def _refill(self) -> None:
        self._log.clear()
        self._push(list(self._lines))

    async def _search_all(self) -> None:
        try:
            lines = await asyncio.to_thread(whole_log, self._folder)
        except JournalError as error:
            self._problems.refuse(error)
            return
        self._lines = lines
        self._refill()
        number = sum(self._fits(line) for line in lines)
        shown = f", the last {_SHOWN} are shown" if number > _SHOWN else ""
        self._found.set_text(f"{number} of {len(lines)} lines{shown}")

    def _fits(self, line: LogLine) -> bool:
        return line.fits(self._kind.value, self._text.value or "")

    def _push(self, lines: list[LogLine]) -> None:
        self._found.set_text("")
        for line in [line for line in lines if self._fits(line)][-_SHOWN:]:
            self._log.push(text_of(line), classes=f"log-{line.kind}")


def text_of(line: LogLine) -> str:
    """A line of the log: time of the cell (s), kind, who, text; further lines of the text indented."""
    who = f"{line.who}: " if line.who and line.kind == "operator" else ""
    text = line.text.replace("\n", "\n" + " " * 24)
    return f"{line.time_s:10.1f} s  {line.kind:<10}{who}{text}"
