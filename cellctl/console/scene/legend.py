"""The legend of the scene: shape, words and count of each role, and the scale of the residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from nicegui import ui

from cellctl.console.scene.colours import COMING, TICKS_MM, UNKNOWN, gradient
from cellctl.console.scene.marks import SHAPES
from cellctl.console.scene.points import Points, Role

WORDS: Mapping[Role, str] = {
    Role.FIT: "of the fit",
    Role.HELD_OUT: "held-out",
    Role.TARGET: "target of the proof",
    Role.CHECK: "check or search",
}

_PATHS = {
    "disc": '<circle cx="8" cy="8" r="5.5"/>',
    "diamond": '<path d="M8 1.5 14.5 8 8 14.5 1.5 8z"/>',
    "triangle": '<path d="M8 1.5 14.5 13.5H1.5z"/>',
    "square": '<path d="M4 4h8v8H4z"/>',
}


@final
class Legend:
    """Names each kind of point that the scene holds, with how many there are."""

    def __init__(self) -> None:
        self._counts: dict[tuple[Role, bool], tuple[ui.element, ui.label]] = {}
        with ui.element("div").classes("scene-legend").props('aria-label="Legend of the scene"'):
            for hollow in (False, True):
                for role in Role:
                    self._counts[role, hollow] = _entry(role, hollow)
        _scale()

    def show(self, groups: Sequence[Points]) -> None:
        """Show the counts of these groups; a kind without points is left out."""
        for (role, hollow), (entry, label) in self._counts.items():
            mine = (group for group in groups if group.role is role)
            count = sum(int(((group.seq == 0) == hollow).sum()) for group in mine)
            if label.text != str(count):
                label.set_text(str(count))
            if entry.visible != bool(count):
                entry.set_visibility(bool(count))


def _entry(role: Role, hollow: bool) -> tuple[ui.element, ui.label]:
    entry = ui.element("span").classes("entry")
    with entry:
        if hollow:
            _drawn(SHAPES[role], "none", COMING, 2.2)
        else:
            _drawn(SHAPES[role], UNKNOWN if role is Role.CHECK else "#28ae80", "#1f2328", 1.2)
        ui.label(f"{SHAPES[role]}{', hollow' if hollow else ''}: {WORDS[role]}, {'to come' if hollow else 'measured'}")
        count = ui.label("0").classes("count")
    entry.set_visibility(False)
    return entry, count


def _drawn(shape: str, fill: str, stroke: str, width: float) -> None:
    look = f'fill="{fill}" stroke="{stroke}" stroke-width="{width}"'
    ui.html(f'<svg width="16" height="16" {look} aria-hidden="true">{_PATHS[shape]}</svg>', sanitize=False)


def _scale() -> None:
    with ui.element("div").classes("scene-legend"):
        with ui.element("div").classes("scene-scale"):
            ui.label("residual, mm")
            ui.element("div").classes("bar").style(f"background: {gradient()}")
            with ui.element("div").classes("ticks"):
                for value in TICKS_MM:
                    ui.label(f"{value:g}")
        with ui.element("span").classes("entry"):
            _drawn("disc", UNKNOWN, "#1f2328", 1.2)
            ui.label("grey: residual not known")
