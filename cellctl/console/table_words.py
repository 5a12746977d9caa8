"""The difference of two tables on a page."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from cellctl.console.look import figures, numbers, state_word, words
from cellctl.report.numbers import fixed

_SHOWN = 30


def difference_words(found: dict[str, Any]) -> None:
    """A difference as `cellctl table diff --json` has it: facts, then rows by the size of their change."""
    if found["same"]:
        state_word("good", f"the same: {found['matched']} rows")
        return
    most = f", by up to {fixed(found['max_change_deg'], 4)}°" if found["changed"] else ""
    tcp = f", the nominal TCP by up to {fixed(found['max_tcp_mm'])} mm" if found["max_tcp_mm"] is not None else ""
    changed = f"{found['matched']} rows are in both, {len(found['changed'])} of them with other joints{most}{tcp}"
    state_word("warning", f"they differ: {changed}")
    for name, only in ((found["a"]["name"], found["only_a"]), (found["b"]["name"], found["only_b"])):
        if only:
            ui.label(f"{len(only)} rows are only in {name}.")
    if found["facts"]:
        facts = [[name, _value(pair["a"]), _value(pair["b"])] for name, pair in found["facts"].items()]
        figures(words("", found["a"]["name"], found["b"]["name"]), facts, label="Facts of the tables")
    if found["changed"]:
        _rows(found["changed"])


def _rows(changed: list[dict[str, Any]]) -> None:
    ordered = sorted(changed, key=lambda row: -row["change_deg"])
    columns = [*numbers("Row"), *words("Joint"), *numbers("Change, °", "Nominal TCP, mm")]
    rows = [
        [
            str(row["row_a"]) if row["row_a"] == row["row_b"] else f"{row['row_a']} → {row['row_b']}",
            f"A{row['joint']}",
            fixed(row["change_deg"], 4),
            fixed(row["tcp_mm"]),
        ]
        for row in ordered[:_SHOWN]
    ]
    with ui.expansion(f"Rows with other joints: the {min(_SHOWN, len(ordered))} with the largest change").classes(
        "wide"
    ):
        figures(columns, rows, label="Rows")


def _value(value: Any) -> str:
    match value:
        case dict():
            return "; ".join(f"{key} {_value(part)}" for key, part in value.items())
        case list():
            return " ".join(f"{part:g}" if isinstance(part, int | float) else str(part) for part in value)
        case str() if len(value) == 64:
            return value[:12]
        case float():
            return f"{value:g}"
        case _:
            return "–" if value is None else str(value)
