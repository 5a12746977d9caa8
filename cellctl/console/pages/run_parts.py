"""Parts of the page of a run: its controls, the tree of its steps, and its log."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import final
from urllib.parse import quote

from nicegui import ui

from cellctl.console import commands
from cellctl.console.appearance import (
    ICONS,
    INKS,
    State,
    command_button,
    is_pausing,
    link_button,
    local_zone,
    section,
    shown_time,
)
from cellctl.console.frame import Commands, answer_of, enable, set_text
from cellctl.console.live import LogLine, Snapshot, whole_log
from cellctl.engine import ActionName, Operator
from cellctl.engine.step_tree import Node, NodeKind, NodeState
from cellctl.journal import JournalError
from cellctl.operations.run_control import question_of
from cellctl.operations.run_notes import LONGEST, notes_of

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
            self._pause = command_button("Pause", lambda: self._act("pause"), icon="pause", gives="pause")
            self._resume = command_button("Continue", lambda: self._act("resume"), icon="play_arrow", gives="resume")
            self._reset = command_button(
                "Reset the simulated cell", lambda: self._act("reset"), icon="restart_alt", gives="reset"
            )
            self._abort = command_button("Abort …", self._on_abort, icon="stop", dangerous=True, gives="abort")
            self._retry = command_button("Retry …", self._on_retry, icon="replay", gives="retry")
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
            command_button("Confirm", lambda: self._act("confirm", step), icon="check", important=True, gives="confirm")

    async def _on_abort(self) -> None:
        with ui.dialog().props('aria-label="Abort the run"') as dialog, ui.card():
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
        with ui.dialog().props('aria-label="Continue the run"') as dialog, ui.card():
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


@final
class RunNotes:
    """Notes of people on a run, and a field for another one."""

    def __init__(self, run_folder: Path) -> None:
        self._folder = run_folder
        with section("Notes", note="Kept beside the journal, with person and time."):
            self._shown()
            with ui.element("div").classes("row search no-print"):
                self._text = ui.input("Note").props(f"outlined dense autogrow maxlength={LONGEST}").classes("grow")
                command_button("Add the note", self._add, icon="note_add", gives="note")
            self._commands = Commands()

    @ui.refreshable_method
    def _shown(self) -> None:
        for note in notes_of(self._folder):
            with ui.element("div"):
                ui.label(f"{shown_time(note.time)}, {note.operator}").classes("note")
                ui.label(note.text).style("white-space: pre-line; overflow-wrap: anywhere")

    async def _add(self) -> None:
        async def add(operator: Operator) -> None:
            await commands.note(operator, self._folder, self._text.value or "")
            self._text.set_value("")
            self._shown.refresh()

        await self._commands.give(add)


def is_simulated(now: Snapshot) -> bool:
    """Whether simulators answered for the devices of the run."""
    return any(identity["simulated"] for identity in now.state.identities.values())


def can_retry(now: Snapshot) -> bool:
    """Whether the run ended early, so that it can be continued at the step that it did not finish."""
    return not now.writing and now.state.started is not None and now.state.state != "finished"


_LOOKS: dict[NodeState, State] = {
    NodeState.WAITING: "off",
    NodeState.RUNNING: "working",
    NodeState.DONE: "good",
    NodeState.FAILED: "bad",
    NodeState.INTERRUPTED: "warning",
    NodeState.SKIPPED: "off",
}
_MOST_FAILED = 5
"""Number of failed passes of a loop that are listed; of the other passes only the current one is."""


@final
@dataclass(frozen=True, slots=True)
class TreeRow:
    """A line of the tree. `depth`: from 0."""

    path: str
    depth: int
    title: str
    state: NodeState
    current: bool
    progress: str
    note: str


def rows_of(tree: Node | None) -> list[TreeRow]:
    """The lines of a tree; of a loop's passes only the current one, and the last ones that failed."""
    return [row for child in tree.children for row in _rows(child, 0)] if tree else []


@final
class RunTree:
    """The tree on a page; `show` sends the lines that changed."""

    def __init__(self) -> None:
        self._shown: list[TreeRow] = []
        self._lines: list[_Line] = []
        self._note = ui.label("This version cannot read the procedure of this run.").classes("note")
        self._list = ui.element("ol").classes("run-tree")

    def show(self, tree: Node | None) -> None:
        """Show `tree`."""
        rows = rows_of(tree)
        if rows == self._shown and self._lines:
            return
        with self._list:
            self._lines += [_Line() for _ in rows[len(self._lines) :]]
        for number, line in enumerate(self._lines):
            before = self._shown[number] if number < len(self._shown) else None
            after = rows[number] if number < len(rows) else None
            if before != after:
                line.show(after)
        self._note.set_visibility(tree is None)
        self._shown = rows


@final
class _Line:
    def __init__(self) -> None:
        with ui.element("li") as self._item:
            self._icon = ui.icon("radio_button_unchecked").props("aria-hidden=true")
            with ui.element("div").classes("words"):
                self._title = ui.label()
                self._note = ui.label().classes("note")
            self._progress = ui.label().classes("passes")
            self._state = ui.label().classes("state")

    def show(self, row: TreeRow | None) -> None:
        self._item.set_visibility(row is not None)
        if row is None:
            return
        look = _LOOKS[row.state]
        self._icon.set_name(ICONS[look])
        self._icon.style(replace=f"color: {INKS[look]}")
        set_text(self._title, row.title)
        set_text(self._note, row.note)
        set_text(self._progress, row.progress)
        set_text(self._state, row.state.value)
        self._item.style(replace=f"padding-left: {0.4 + 1.1 * row.depth:.1f}rem")
        self._item.props("aria-current=step" if row.current else "", remove="" if row.current else "aria-current")


def _rows(node: Node, depth: int) -> Iterator[TreeRow]:
    retried = f"retried {node.retried} ×" if node.retried else ""
    note = " · ".join(filter(None, (retried, node.failure.partition("\n")[0])))
    yield TreeRow(node.path, depth, _title(node), node.state, node.current, _progress(node), note)
    if node.kind is NodeKind.LOOP and any(child.kind is NodeKind.PASS for child in node.children):
        for each in _passes(node):
            yield from _rows(each, depth + 1)
        return
    for child in node.children:
        yield from _rows(child, depth + 1)


def _passes(loop: Node) -> list[Node]:
    """The current pass, and the last ones that failed, in their order."""
    failed = [each for each in loop.children if each.state is NodeState.FAILED and not each.current]
    shown = {each.path for each in [*failed[-_MOST_FAILED:], *(each for each in loop.children if each.current)]}
    return [each for each in loop.children if each.path in shown]


def _title(node: Node) -> str:
    title = node.title.partition("\n")[0]
    if node.kind is NodeKind.PASS:
        return f"Pass {title}"
    return f"Confirm: {title}" if node.kind is NodeKind.CONFIRM else title[:1].upper() + title[1:]


def _progress(node: Node) -> str:
    if node.kind is not NodeKind.LOOP:
        return ""
    return f"{node.done} of {'?' if node.total is None else node.total}"


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
        with ui.element("div").classes("row no-print"):
            self._kind = ui.select(KINDS, value="", label="Kind", on_change=lambda: self._refill())
            self._kind.props("outlined dense options-dense").style("min-width: 12rem")
            self._text = ui.input("Text", on_change=lambda: self._refill()).props(
                "outlined dense clearable debounce=200"
            )
            command_button("Search the whole log", self._search_all, icon="manage_search")
            self._found = ui.label().classes("note").props("role=status")
        self._problems = Commands()
        ui.label(f"Clock time ({local_zone()}) where it is known, then the time of the cell.").classes("note")
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
    """A line of the log: clock time, time of the cell (s), kind, who, text; further lines of the text indented."""
    who = f"{line.who}: " if line.who and line.kind == "operator" else ""
    text = line.text.replace("\n", "\n" + " " * 33)
    clock = shown_time(line.clock, "%H:%M:%S") if line.clock else ""
    return f"{clock:8} {line.time_s:9.1f} s  {line.kind:<10}{who}{text}"
