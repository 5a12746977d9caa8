"""`/tables`: compensation tables of each controller: history, differences; dialog for push, verify and rollback."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, final
from urllib.parse import quote

from nicegui import ui

from cellctl.console.appearance import (
    Cell,
    command_button,
    figures,
    numbers,
    problem_list,
    section,
    shown_time,
    state_word,
    words,
)
from cellctl.console.commands import examinations, found_rows, request_for, start_action, start_look, why_busy
from cellctl.console.frame import JobView, follow, follow_event, frame, with_operator
from cellctl.console.jobs import Job
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.installed import shipped
from cellctl.journal.journal_file import FILE_NAME
from cellctl.operations.results import from_json
from cellctl.operations.run_folder import SIMULATOR_MEMORY
from cellctl.operations.run_list import RunSummary
from cellctl.operations.table import Pushed, RolledBack, Verified
from cellctl.operations.table_actions import Action, TableLook, TableRequest, known_table, refuse_confirmation
from cellctl.operations.table_diff import ComparedTable, RowChange, TableDifference, table_difference
from cellctl.operations.table_history import ControllerTables, KnownTable, TableChange, short, table_overview
from cellctl.report.figures import fixed
from cellctl.run_index import RunFilter

_SHOWN = 30


def difference_words(found: TableDifference) -> None:
    """A difference: facts, then rows by the size of their change."""
    if found.same:
        state_word("good", f"the same: {found.matched} rows")
        return
    most = f", by up to {fixed(found.max_change_deg, 4)}°" if found.changed else ""
    tcp = f", the nominal TCP by up to {fixed(found.max_tcp_mm)} mm" if found.max_tcp_mm is not None else ""
    changed = f"{found.matched} rows are in both, {len(found.changed)} of them with other joints{most}{tcp}"
    state_word("warning", f"they differ: {changed}")
    for name, only in ((found.a.name, found.only_a), (found.b.name, found.only_b)):
        if only:
            ui.label(f"{len(only)} rows are only in {name}.")
    if found.facts:
        facts = [[name, _value(pair.a), _value(pair.b)] for name, pair in found.facts.items()]
        figures(words("Fact", found.a.name, found.b.name), facts, label="Facts of the tables")
    if found.changed:
        _rows(found.changed)


def _rows(changed: list[RowChange]) -> None:
    ordered = sorted(changed, key=lambda row: -row.change_deg)
    columns = [*numbers("Row"), *words("Joint"), *numbers("Change, °", "Nominal TCP, mm")]
    rows = [
        [
            str(row.row_a) if row.row_a == row.row_b else f"{row.row_a} → {row.row_b}",
            f"A{row.joint}",
            fixed(row.change_deg, 4),
            fixed(row.tcp_mm),
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


_TITLES: dict[Action, str] = {
    "push": "Push table {}",
    "verify": "Verify table {}",
    "rollback": "Roll back to the table before",
}


@final
class TableAction:
    """One action on the table of a controller, step by step. then: called when the controller was changed."""

    def __init__(self, then: Callable[[], Awaitable[None]]) -> None:
        self._then = then
        self._busy: tuple[Path, Problem] | None = None
        follow_event(self._free, _each_job_and_examination, "the controller")
        with (
            ui.dialog().props('persistent aria-label="Table of the controller"') as self._dialog,
            ui.card().classes("table-action"),
        ):
            self._content = ui.element("div").classes("section wide")

    def close(self) -> None:
        """Close the dialog."""
        self._dialog.close()

    async def open(self, operator: Operator, action: Action, table: str, serial: str) -> None:
        """Begin `action` with the table of this id (empty: the one before) on the controller `serial`."""
        self._operator, self._action, self._table, self._serial = operator, action, table, serial
        rows = await found_rows(RunFilter(serial=serial), limit=_LATEST)
        self._content.clear()
        with self._content:
            ui.label(_TITLES[action].format(short(table))).classes("section-title")
            self._cell, self._memory = _cell_choice(rows)
            self._problems = ui.element("div")
            first = "Compare with the controller" if action == "verify" else "Look at the controller"
            with ui.element("div").classes("row") as self._begin:
                command_button(first, self._verify if action == "verify" else self._look, important=True)
                command_button("Close", self.close)
            self._seen_view = JobView(self._seen)
            self._act_view = JobView(self._done)
        self._dialog.open()

    def _request(self, **more: str) -> TableRequest:
        return request_for(self._action, self._cell.value or "", self._table, self._memory.value or "", **more)

    async def _look(self) -> None:
        await self._started(start_look, self._seen_view)

    async def _verify(self) -> None:
        await self._started(start_action, self._act_view)

    async def _started(
        self, start: Callable[[Operator, TableRequest], Awaitable[Job]], view: JobView, **more: str
    ) -> None:
        self._busy, cell = None, None
        self._problems.clear()
        self._act_view.clear()
        try:
            request = self._request(**more)
            cell = request.cell
            view.follow(await start(self._operator, request))
        except InputError as error:
            if cell and (busy := why_busy(cell)) in error.problems:
                self._busy = cell, busy
            with self._problems:
                problem_list(error.problems)

    def _free(self) -> None:
        """Remove the notice of a busy controller once it is not."""
        if self._busy and why_busy(self._busy[0]) != self._busy[1]:
            self._busy = None
            self._problems.clear()

    def _seen(self, result: object) -> None:
        """What the controller has, and what would change; then the confirmation."""
        found = from_json(TableLook, result)
        active = found.active
        word = f"in force: {short(active.id)}, {active.rows} rows" if active else "no table is in force"
        kind = "simulated controller" if found.simulated else "controller"
        ui.label(f"{kind} {found.serial}: {word}")
        if found.record:
            state_word("warning", f"Not as recorded: {found.record}")
        if found.refused:
            state_word("bad", "This table is refused for this controller:")
            for why in found.refused:
                ui.label(why)
            return
        if active and active.id == found.target:
            state_word("good", "This table is in force already: there is nothing to push.")
            return
        target = short(found.target) if found.target else "no table"
        ui.label(f"Afterwards in force: {target}").classes("section-title")
        if found.difference:
            difference_words(found.difference)
        elif active and found.target:
            ui.label("The rows of one of the tables are not recorded here: their difference is not known.")
        self._confirmation(found, active.id if active else "")

    def _confirmation(self, found: TableLook, seen: str) -> None:
        names = f"the controller's serial, {found.serial}"
        if found.target:
            names += f", or the table's id, {short(found.target)}"
        ui.label(f"To confirm, type {names}:")

        def wrong(text: str | None) -> str | None:
            try:
                refuse_confirmation(text or "", found.serial, found.target or "")
            except InputError as error:
                return f"This {error.problems[0].what}."
            return None

        typed = ui.input("Confirmation", validation=wrong).props("outlined dense autofocus").classes("wide")
        typed.without_auto_validation().on_value_change(lambda: setattr(typed, "error", None))

        async def confirmed() -> None:
            if not typed.validate():
                return
            await self._started(start_action, self._act_view, seen=seen, confirmed=typed.value or "")

        typed.on("keydown.enter", confirmed)
        with ui.element("div").classes("row"):
            command_button("Push" if self._action == "push" else "Roll back", confirmed, dangerous=True)

    def _done(self, content: object) -> None:
        if self._action == "verify":
            _verified(from_json(Verified, content))
            return
        self._seen_view.clear()
        self._begin.clear()
        with self._begin:
            command_button("Close", self.close, important=True)
        done = from_json(Pushed, content) if self._table else from_json(RolledBack, content)
        if isinstance(done, Pushed):
            word = f"Table {short(done.id)} is in force on {done.serial}: {done.rows} rows, read back"
        else:
            word = f"In force on {done.serial}: {short(done.active.id) if done.active else 'no table'}"
        state_word("good", word, large=True)
        if not done.recorded:
            state_word("warning", "The history of tables could not be written.")
        ui.timer(0.0, self._then, once=True)


def _verified(found: Verified) -> None:
    word = f"in force, all {found.rows} rows as in the file" if found.same else "not the table in force"
    state_word("good" if found.same else "bad", word, large=True)
    for text in found.differences:
        ui.label(text)


def _each_job_and_examination(changed: Callable[[], None]) -> Callable[[], None]:
    ends = (console().jobs.subscribe(lambda _: changed()), examinations.add(changed))

    def end() -> None:
        for each in ends:
            each()

    return end


_LATEST = 50
"""Number of runs of a robot among which those are whose simulated controller's memory is offered."""


def _cell_choice(latest: list[RunSummary]) -> tuple[ui.select, ui.select]:
    """The cell whose controller is meant, and for a simulated one the run whose memory it continues, of the robot's
    latest runs.
    """
    own = console().settings.cell
    names = {"": f"{own.stem} (this console's)"} if own else {}
    names |= {name: name for name in shipped("cell")}
    rows = [row for row in latest if row.cell]
    used = next((_stem(row.cell) for row in rows), "")
    first = "" if own else used if used in names else next(iter(names))

    def chosen(event: Any) -> None:
        found = _memories(rows, event.value or _stem(own))
        memory.set_options(found, value=next(reversed(found)))
        memory.set_visibility(len(found) > 1)

    with ui.element("div").classes("row search"):
        cell = ui.select(names, label="Cell", value=first, on_change=chosen).props("outlined dense").classes("grow")
        found = _memories(rows, first or _stem(own))
        memory = ui.select(found, label="Memory of the simulated controller", value=next(reversed(found)))
        memory.props("outlined dense").classes("grow").set_visibility(len(found) > 1)
    return cell, memory


def _memories(rows: list[RunSummary], cell: str) -> dict[str, str]:
    """Runs on the cell with this name that have a simulated controller's memory, the newest last."""
    own = [row.run for row in reversed(rows) if _stem(row.cell) == cell]
    return {"": "none: a new controller", **{run: run for run in own if _memory(run).is_file()}}


def _memory(run: str) -> Path:
    return console().runs / run / SIMULATOR_MEMORY


def _stem(cell: object) -> str:
    return Path(str(cell)).stem


@ui.page("/tables")
def tables(serial: str = "") -> None:
    """The tables of each controller."""
    with frame("Compensation tables", "/tables"):
        shown = _Tables(serial)
        follow(shown.follow)


@final
class _Tables:
    """The tables of the chosen controller."""

    def __init__(self, serial: str) -> None:
        self._serial = serial
        self._seen: Any = None
        self._found: list[ControllerTables] = []
        self._choice = ui.element("div")
        self._action = TableAction(self.read)
        self._area = ui.element("div").style("display: contents")

    async def follow(self) -> None:
        """Read again if a run has begun, ended, gone, or changed its table."""
        now = console().live.states_version
        if now != self._seen:
            self._seen = now
            await self.read()

    async def read(self) -> None:
        """Read the histories in a thread, and show them if they have changed."""
        found = await asyncio.to_thread(table_overview, console().runs)
        if found != self._found or not found:
            self._found = found
            self._show()

    def _show(self) -> None:
        self._choice.clear()
        self._area.clear()
        if not self._found:
            with self._area:
                ui.label("No table is here yet: a campaign makes one.")
            return
        serials = [each.serial for each in self._found]
        one = next((each for each in self._found if each.serial == self._serial), self._found[0])
        with self._choice:
            ui.select(serials, label="Controller", value=one.serial, on_change=self._chosen).props(
                "outlined dense"
            ).style("min-width: 16rem; max-width: 20rem")
        with self._area:
            _in_force(one)
            _known(one, self._action)
            _Difference(one)
            _history(one)

    def _chosen(self, event: Any) -> None:
        self._serial = event.value
        self._action.close()
        self._show()


def _in_force(one: ControllerTables) -> None:
    last = one.changes[0] if one.changes else None
    with ui.element("div").classes("row"):
        if last is None:
            state_word("unknown", "no table was put in force from this folder of runs", large=True)
        elif last.state == "in force":
            word = f"{short(last.table)} is in force" if last.table else "no table is in force"
            state_word("good" if last.table else "off", word, large=True)
            ui.label(f"since {shown_time(last.time)}, {last.action} by {_by(last)}").classes("note")
        else:
            state_word("warning", f"{last.action} of {short(last.table)}: {last.state}", large=True)
            ui.label(last.reason or "").classes("note")
    ui.label("As recorded here. The controller itself is asked before each change.").classes("note")
    for text in one.unreadable:
        state_word("bad", text)


def _known(one: ControllerTables, action: TableAction) -> None:
    """The tables that can be put in force, with the actions."""

    def asked(what: Any, table: str = "") -> Any:
        async def go(operator: Operator) -> None:
            await action.open(operator, what, table, one.serial)

        return lambda: with_operator(go)

    def row(each: KnownTable) -> list[Cell]:
        def name() -> None:
            ui.label(short(each.id)).classes("mono").tooltip(each.id)
            if each.id == one.in_force:
                state_word("good", "in force")

        def actions() -> None:
            with ui.element("div").classes("row"):
                for title, what in (("Push", "push"), ("Verify", "verify")):
                    button = command_button(title, asked(what, each.id), gives=f"table {what}")
                    button.props(f'aria-label="{title} {short(each.id)}"')

        facts = (shown_time(each.created), each.method, lambda: _run_link(each.run))
        return [name, *facts, str(each.rows), fixed(each.max_correction_deg), actions]

    columns = [
        *words("Table", "Created", "Method", "Run"),
        *numbers("Rows", "Largest correction, °"),
        *words("Actions"),
    ]
    with section("Tables for this controller"):
        with ui.element("div").classes("row"):
            command_button(
                "Roll back to the table before", asked("rollback"), icon="undo", dangerous=True, gives="table rollback"
            )
        figures(columns, map(row, one.tables), label="Tables")


def _run_link(run: str | None) -> None:
    if run and (console().runs / run / FILE_NAME).is_file():
        ui.link(run, f"/run/{quote(run)}/result")
    else:
        ui.label(run or "–")


@final
class _Difference:
    """The difference of two tables."""

    def __init__(self, one: ControllerTables) -> None:
        tables_ = {each.id: f"{short(each.id)}, {shown_time(each.created)}" for each in one.tables}
        if len(tables_) < 2:
            return
        ids = list(tables_)
        with section("Difference of two tables"):
            with ui.element("div").classes("row search"):
                self._a = ui.select(tables_, label="From", value=ids[1], on_change=self.show).props("outlined dense")
                self._b = ui.select(tables_, label="To", value=ids[0], on_change=self.show).props("outlined dense")
            self._area = ui.element("div").classes("section")
        ui.timer(0.0, self.show, once=True)

    async def show(self, _: object = None) -> None:
        """Show the difference of the chosen tables."""

        def found() -> TableDifference:
            pair = [ComparedTable.of_file(short(each), known_table(console().runs, each)) for each in (a, b)]
            return table_difference(pair[0], pair[1], None)

        a, b = str(self._a.value), str(self._b.value)
        try:
            difference = await asyncio.to_thread(found)
        except InputError as error:
            self._area.clear()
            with self._area:
                problem_list(error.problems)
            return
        self._area.clear()
        with self._area:
            difference_words(difference)


def _history(one: ControllerTables) -> None:
    columns = [*words("Since", "Until", "Table", "Change, by whom"), *numbers("Rows"), *words("State")]
    rows = [
        [
            shown_time(each.time),
            shown_time(each.until),
            short(each.table),
            f"{each.action}, {_by(each)}",
            str(each.rows or "–"),
            f"{each.state}: {why}" if (why := each.out_of_force or each.reason) else each.state,
        ]
        for each in one.changes
    ]
    with section("History", note="Every table that was put in force, by whom, when and from which run."):
        figures(columns, rows, label="History")


def _by(change: TableChange) -> str:
    return f"run {change.run}, {change.who}" if change.run else change.who
