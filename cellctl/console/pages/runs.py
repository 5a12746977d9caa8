"""`/runs`: the list of runs, its search, and the choice of two to compare."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, final
from urllib.parse import quote, urlencode

from nicegui import ui

from cellctl.console.appearance import (
    ICONS,
    INKS,
    State,
    look_of_state,
    look_of_verdict,
    progress_of,
    sentence_of,
    shown_time,
)
from cellctl.console.commands import live_rows
from cellctl.console.frame import follow, frame
from cellctl.console.shared import console
from cellctl.operations.run_list import RunFilter, RunSummary
from cellctl.report.figures import fixed

_NUMBER = {"align": "right", "classes": "number", "headerClasses": "number"}
_TEXT = {"align": "left"}
_COLUMNS: list[dict[str, Any]] = [
    {"name": "run", "label": "Run", "field": "run", "sortable": True, **_TEXT},
    {"name": "began", "label": "Began", "field": "began", "sortable": True, **_TEXT},
    {"name": "serial", "label": "Robot", "field": "serial", "sortable": True, **_TEXT},
    {"name": "state", "label": "State", "field": "state", "sortable": True, **_TEXT},
    {"name": "verdict", "label": "Verdict, or progress", "field": "verdict", "sortable": True, **_TEXT},
    {"name": "points", "label": "Points", "field": "points", "sortable": True, **_NUMBER},
    {"name": "before", "label": "Before, mm", "field": "before", "sortable": True, **_NUMBER},
    {"name": "after", "label": "After, mm", "field": "after", "sortable": True, **_NUMBER},
    {"name": "acceptance", "label": "Acceptance", "field": "acceptance", "sortable": True, **_TEXT},
    {"name": "table", "label": "Table", "field": "table", "sortable": True, **_TEXT},
]
_RUN_CELL = '<q-td :props="props"><a :href="props.row.link">{{ props.value }}</a></q-td>'
_WORD_CELL = (
    '<q-td :props="props"><span v-if="props.value" class="state-word" :style="{color: props.row.NAME_look.colour}">'
    '<q-icon :name="props.row.NAME_look.icon" aria-hidden="true"></q-icon>{{ props.value }}</span>'
    "<span v-else>–</span></q-td>"
)
_CHOICE = '<q-checkbox dense v-model="props.selected" :aria-label="\'Choose \' + props.row.run"></q-checkbox>'
_CHOICE_OF_ALL = '<q-checkbox dense v-model="props.selected" aria-label="Choose all runs"></q-checkbox>'
_ANY = "any"


@ui.page("/runs")
async def runs(
    text: str = "",
    state: str = "",
    verdict: str = "",
    serial: str = "",
    procedure: str = "",
    since: str = "",
    until: str = "",
) -> None:
    """The list of runs."""
    with frame("Runs", "/runs"):
        shown = _RunList(RunFilter(text, state, verdict, serial, procedure, since, until))
        follow(shown.show)


@final
class _RunList:
    """The search and its result."""

    def __init__(self, asked: RunFilter) -> None:
        self._asked = asked
        self._seen: Any = None
        self._rows = live_rows()
        self._search()
        with ui.element("div").classes("row"):
            self._count = ui.label().classes("note").props("role=status")
            self._compare = ui.link("Compare two chosen runs", "/compare").classes("command linked")
        self._table = ui.table(columns=_COLUMNS, rows=[], row_key="run", selection="multiple", pagination=25)
        self._table.classes("runs").props("flat dense rows-per-page-options=[25,50,100,0]")
        self._table.add_slot("body-cell-run", _RUN_CELL)
        self._table.add_slot("body-selection", _CHOICE)
        self._table.add_slot("header-selection", _CHOICE_OF_ALL)
        for name in ("state", "verdict", "acceptance"):
            self._table.add_slot(f"body-cell-{name}", _WORD_CELL.replace("NAME", name))
        self._table.on_select(self._show_choice)

    def show(self) -> None:
        """Show the runs as they are now; sends nothing if no row has changed."""
        live = console().live
        now = (live.rows, live.reading, [live.run(name).snapshot.version for name in live.active])
        if now != self._seen:
            self._seen, self._rows = now, live_rows()
            self._show()

    def _search(self) -> None:
        with ui.element("div").classes("row search").props("role=search"):
            ui.input("Search", value=self._asked.text, on_change=self._field("text")).props(
                "outlined dense clearable debounce=250"
            ).classes("grow").tooltip("Words in name, files, operator, devices or verdict")
            for name, label, values in (
                ("state", "State", {row.state for row in self._rows}),
                ("verdict", "Verdict", {row.verdict for row in self._rows if row.verdict}),
                ("procedure", "Procedure", {row.procedure_name for row in self._rows} - {""}),
                ("serial", "Robot", {row.serial for row in self._rows} - {""}),
            ):
                known = str(getattr(self._asked, name))
                options = {"": _ANY, **{value: value for value in sorted(values | ({known} if known else set()))}}
                ui.select(options, label=label, value=known, on_change=self._field(name)).props("outlined dense")
            for name, label in (("since", "From day"), ("until", "To day")):
                ui.input(label, value=getattr(self._asked, name), on_change=self._field(name)).props(
                    "outlined dense type=date stack-label"
                )

    def _field(self, name: str) -> Callable[[Any], None]:
        def changed(event: Any) -> None:
            self._asked = replace(self._asked, **{name: event.value or ""})
            self._show()

        return changed

    def _show(self) -> None:
        found = [row for row in self._rows if self._asked.keeps(row)]
        cells = [_cells(row) | _progress(row) for row in found]
        if cells != self._table.rows:
            self._table.rows = cells
        kept = [row for row in self._table.rows if row["run"] in self._chosen()]
        if kept != self._table.selected:  # else it would take back what was chosen on the page since
            self._table.selected = kept
        reading = ", reading more …" if console().live.reading else ""
        self._count.set_text(f"{len(found)} of {len(self._rows)} runs in {console().runs}{reading}")
        self._show_choice()

    def _chosen(self) -> list[str]:
        return [row["run"] for row in self._table.selected]

    def _show_choice(self, _: object = None) -> None:
        chosen = self._chosen()
        ready = len(chosen) == 2
        self._compare.props(
            f"href=/compare?{urlencode({'b': chosen[0], 'a': chosen[1]})}" if ready else "href=/compare"
        )
        self._compare.text = "Compare the two chosen runs" if ready else "Compare runs (choose two)"


def _cells(row: RunSummary) -> dict[str, Any]:
    return {
        "run": row.run,
        "link": f"/run/{quote(row.run)}{'' if row.process else '/result'}",
        "began": shown_time(row.began),
        "serial": row.serial or "–",
        "state": row.state,
        "state_look": _look(look_of_state(row)),
        "verdict": row.verdict or "",
        "verdict_look": _look(look_of_verdict(row.verdict)),
        "points": row.points,
        "before": fixed(row.before and row.before.mean),
        "after": fixed(row.after and row.after.mean),
        "acceptance": row.accepted,
        "acceptance_look": _look(look_of_verdict(row.accepted)),
        "table": row.table_state or "–",
    }


def _progress(row: RunSummary) -> dict[str, Any]:
    """Of a run in progress, what it does in place of its state, and its progress in place of a verdict."""
    if row.run not in console().live.active:
        return {}
    now = console().live.run(row.run).snapshot
    state, sentence = sentence_of(now)
    _, progress = progress_of(now)
    doing = sentence.partition(": ")[0].rstrip(".… ") if now.events else row.state
    return {"state": doing, "state_look": _look(state), "verdict": progress, "verdict_look": _look(state)}


def _look(state: State) -> dict[str, str]:
    return {"icon": ICONS[state], "colour": INKS[state]}
