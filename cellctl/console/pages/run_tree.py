"""The procedure of a run as an indented list: state of each step, progress of loops, the current step marked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

from nicegui import ui

from cellctl.console.look import COLOURS, ICONS, State
from cellctl.console.page_commands import set_text
from cellctl.engine.step_tree import Node, NodeKind, NodeState

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
        self._icon.style(replace=f"color: {COLOURS[look]}")
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
