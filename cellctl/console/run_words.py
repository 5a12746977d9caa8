"""States, verdicts and numbers of runs as pages show them."""

from __future__ import annotations

from nicegui import ui

from cellctl.console.look import State
from cellctl.operations.run_list import RunRow
from cellctl.report.numbers import fixed

_STATES: dict[str, State] = {
    "finished": "good",
    "aborted": "off",
    "failed": "bad",
    "uncertain": "bad",
    "unreadable": "bad",
    "paused": "waiting",
}
_VERDICTS: dict[str, State] = {
    "better": "good",
    "in control": "good",
    "measured": "good",
    "baseline": "off",
    "no better": "warning",
    "measure again": "warning",
    "worse": "bad",
    "recalibrate": "bad",
}


def look_of_state(row: RunRow) -> State:
    """How the state of a run looks."""
    word = str(row["state"])
    return _STATES.get(word) or ("bad" if word.startswith("cut off") else "working")


def look_of_verdict(word: object) -> State:
    """How a verdict looks."""
    return _VERDICTS.get(str(word), "unknown")


def shown_time(began: object) -> str:
    """`2026-11-21 19:24`, UTC; a dash without it."""
    return str(began)[:16].replace("T", " ") if began else "–"


def mm(value: float | None, places: int = 3) -> str:
    """A length in mm; a dash for None."""
    return fixed(value, places)


def figures(
    columns: list[tuple[str, str]], rows: list[list[str]], *, label: str, marked: frozenset[int] = frozenset()
) -> None:
    """A table that scrolls in itself. columns: title and class (`words` for text, empty for numbers).

    marked: rows, from 0, with a coloured ground; a word in the row says the same.
    """
    scrolling = ui.element("div").classes("scrolling").props(f'tabindex=0 role=region aria-label="{label}"')
    with scrolling, ui.element("table").classes("figures"):
        with ui.element("thead"), ui.element("tr"):
            for title, kind in columns:
                with ui.element("th").classes(kind).props("scope=col"):
                    ui.label(title)
        with ui.element("tbody"):
            for number, row in enumerate(rows):
                with ui.element("tr").classes("differs" if number in marked else ""):
                    for text, (_, kind) in zip(row, columns, strict=True):
                        with ui.element("td").classes(kind):
                            ui.label(text)
