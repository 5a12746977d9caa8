"""`/runs`: the list of runs, its search, and the choice of two to compare."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from datetime import UTC, date, datetime, time, timedelta
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
from cellctl.console.commands import indexed
from cellctl.console.frame import follow, frame
from cellctl.console.shared import console
from cellctl.operations.run_indexing import summary_of
from cellctl.operations.run_list import RunSummary
from cellctl.report.figures import fixed
from cellctl.run_index import FoundRun, RunFilter, RunIndex

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
_ORDERS = {"before": "before_mm", "after": "after_mm", "table": "table_state"}
"""Columns of the index by those of the page, where they differ."""
_CHOICES = {"state": "State", "verdict": "Verdict", "procedure": "Procedure", "serial": "Robot"}


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
    """The search and a page of its result."""

    def __init__(self, asked: RunFilter) -> None:
        self._asked = asked
        self._seen: Any = None
        self._found = 0
        self._selects: dict[str, ui.select] = {}
        self._search()
        with ui.element("div").classes("row"):
            self._count = ui.label().classes("note").props("role=status")
            self._compare = ui.link("Compare two chosen runs", "/compare").classes("command linked")
        first = {"page": 1, "rowsPerPage": 25, "sortBy": "began", "descending": True, "rowsNumber": 0}
        self._table = ui.table(columns=_COLUMNS, rows=[], row_key="run", selection="multiple", pagination=first)
        self._table.classes("runs").props("flat dense binary-state-sort rows-per-page-options=[25,50,100]")
        self._table.add_slot("body-cell-run", _RUN_CELL)
        self._table.add_slot("body-selection", _CHOICE)
        self._table.add_slot("header-selection", _CHOICE_OF_ALL)
        for name in ("state", "verdict", "acceptance"):
            self._table.add_slot(f"body-cell-{name}", _WORD_CELL.replace("NAME", name))
        self._table.on_select(self._show_choice)
        self._table.on("request", self._turned)
        self._table.on_pagination_change(self._keep_number)

    async def show(self) -> None:
        """Show the runs as they are now, if any has changed."""
        live = console().live
        now = (live.version, live.reading, [live.run(name).snapshot.version for name in live.active])
        if now != self._seen:
            self._seen = now
            await self._show()

    def _search(self) -> None:
        with ui.element("div").classes("row search").props("role=search"):
            ui.input("Search", value=self._asked.text, on_change=self._field("text")).props(
                "outlined dense clearable debounce=250"
            ).classes("grow").tooltip("Words in name, files, operator, devices or verdict")
            for name, label in _CHOICES.items():
                known = str(getattr(self._asked, name))
                options = {"": _ANY, **({known: known} if known else {})}
                self._selects[name] = ui.select(options, label=label, value=known, on_change=self._field(name))
                self._selects[name].props("outlined dense")
            for name, label in (("since", "From day"), ("until", "To day")):
                ui.input(label, value=getattr(self._asked, name), on_change=self._field(name)).props(
                    "outlined dense type=date stack-label"
                )

    def _field(self, name: str) -> Callable[[Any], Awaitable[None]]:
        async def changed(event: Any) -> None:
            self._asked = replace(self._asked, **{name: event.value or ""})
            self._table.pagination = {**self._table.pagination, "page": 1}
            await self._show()

        return changed

    def _keep_number(self, _: object = None) -> None:
        """Tell the page how many rows there are: it answers each change with the number that it had before."""
        if self._table.pagination["rowsNumber"] != self._found:
            self._table.pagination = {**self._table.pagination, "rowsNumber": self._found}

    async def _turned(self, event: Any) -> None:
        """Another page, order, or number of rows."""
        self._table.pagination = {**self._table.pagination, **event.args["pagination"]}
        await self._show()

    async def _show(self) -> None:
        turned, asked = self._table.pagination, self._asked
        size = turned["rowsPerPage"]
        order = _ORDERS.get(turned["sortBy"], turned["sortBy"])
        wanted = replace(asked, since=seconds_of_day(asked.since)[0], until=seconds_of_day(asked.until)[1])

        def read(index: RunIndex) -> tuple[list[FoundRun], int, int, dict[str, list[str]]]:
            found = index.page(
                wanted,
                offset=(turned["page"] - 1) * size,
                limit=size,
                order=order or "began",
                descending=bool(turned["descending"]) or not order,
            )
            return found, index.count(wanted), index.count(), {name: index.values(name) for name in _CHOICES}

        found, count, total, values = await indexed(read, wait=False)
        if asked != self._asked:
            return  # typed on meanwhile: that one is shown
        for name, select in self._selects.items():
            options = {"": _ANY, **{value: value for value in sorted({*values[name], getattr(asked, name)} - {""})}}
            if options != select.options:
                select.set_options(options)
        rows = [summary_of(each) for each in found]
        cells = [_cells(row) | _progress(row) for row in rows]
        self._found = count
        self._keep_number()
        if cells != self._table.rows:
            self._table.rows = cells
        reading = ", reading more …" if console().live.reading else ""
        self._count.set_text(f"{count} of {total} runs in {console().runs}{reading}")
        self._show_choice()

    def _show_choice(self, _: object = None) -> None:
        chosen = [row["run"] for row in self._table.selected]
        ready = len(chosen) == 2
        self._compare.props(
            f"href=/compare?{urlencode({'b': chosen[0], 'a': chosen[1]})}" if ready else "href=/compare"
        )
        self._compare.text = "Compare the two chosen runs" if ready else "Compare runs (choose two)"


def seconds_of_day(day: str) -> tuple[str, str]:
    """The first and the last second, UTC, of a day in the zone of the console's computer; as it is if it is no day."""
    try:
        begins = datetime.combine(date.fromisoformat(day), time())  # without a zone: that of the computer
    except ValueError:
        return day, day
    ends = begins + timedelta(days=1, seconds=-1)
    first, last = (f"{each.astimezone(UTC):%Y-%m-%dT%H:%M:%S}" for each in (begins, ends))
    return first, last


def _cells(row: RunSummary) -> dict[str, Any]:
    return {
        "run": row.run,
        "link": f"/run/{quote(row.run)}{'' if row.process else '/result'}",
        "began": shown_time(row.began),
        "serial": row.serial or "–",
        "state": row.state if row.note in (None, row.state) else f"{row.state}, {row.note}",
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
