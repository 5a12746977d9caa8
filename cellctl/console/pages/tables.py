"""`/tables`: the compensation tables of each controller: history, differences, push, verify and rollback."""

from __future__ import annotations

import asyncio
from typing import Any, final
from urllib.parse import quote

from nicegui import ui

from cellctl.console.following import follow
from cellctl.console.frame import frame, with_operator
from cellctl.console.known_runs import live_rows
from cellctl.console.look import Cell, command_button, figures, numbers, problem_list, section, state_word, words
from cellctl.console.run_words import shown_time
from cellctl.console.shared import console
from cellctl.console.table_dialog import TableAction
from cellctl.console.table_words import difference_words
from cellctl.engine import Operator
from cellctl.files import InputError
from cellctl.operations.table_changes import short
from cellctl.operations.table_overview import table_overview
from cellctl.report.numbers import fixed


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
        self._found: list[dict[str, Any]] = []
        self._choice = ui.element("div")
        self._action = TableAction(self.read)
        self._area = ui.element("div").style("display: contents")

    async def follow(self) -> None:
        """Read again if a run has begun, ended, gone, or changed its table."""
        now = [(row.run, row.state, row.summary.get("table_state")) for row in console().live.rows]
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
                ui.label("No table is here yet: a campaign makes one, and `cellctl compensate`.")
            return
        serials = [each["serial"] for each in self._found]
        one = next((each for each in self._found if each["serial"] == self._serial), self._found[0])
        with self._choice:
            ui.select(serials, label="Controller", value=one["serial"], on_change=self._chosen).props(
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


def _in_force(one: dict[str, Any]) -> None:
    last = one["changes"][0] if one["changes"] else None
    with ui.element("div").classes("row"):
        if last is None:
            state_word("unknown", "no table was put in force from this folder of runs", large=True)
        elif last["state"] == "in force":
            word = f"{short(last['table'])} is in force" if last["table"] else "no table is in force"
            state_word("good" if last["table"] else "off", word, large=True)
            ui.label(f"since {shown_time(last['time'])} UTC, {last['action']} by {_by(last)}").classes("note")
        else:
            state_word("warning", f"{last['action']} of {short(last['table'])}: {last['state']}", large=True)
            ui.label(str(last["reason"] or "")).classes("note")
    ui.label("As recorded here. The controller itself is asked before each change.").classes("note")
    for text in one["unreadable"]:
        state_word("bad", text)


def _known(one: dict[str, Any], action: TableAction) -> None:
    """The tables that can be put in force, with the actions."""

    def asked(what: Any, table: str = "") -> Any:
        async def go(operator: Operator) -> None:
            await action.open(operator, what, table, one["serial"])

        return lambda: with_operator(go)

    in_force = one["changes"][0]["table"] if one["changes"] and one["changes"][0]["state"] == "in force" else None

    def row(each: dict[str, Any]) -> list[Cell]:
        def name() -> None:
            ui.label(short(each["id"])).classes("mono").tooltip(each["id"])
            if each["id"] == in_force:
                state_word("good", "in force")

        def actions() -> None:
            with ui.element("div").classes("row"):
                for title, what in (("Push", "push"), ("Verify", "verify")):
                    button = command_button(title, asked(what, each["id"]))
                    button.props(f'aria-label="{title} {short(each["id"])}"')

        facts = (shown_time(each["created"]), each["method"], lambda: _run_link(each["run"]))
        return [name, *facts, str(each["rows"]), fixed(each["max_correction_deg"]), actions]

    columns = [
        *words("Table", "Created", "Method", "Run"),
        *numbers("Rows", "Largest correction, °"),
        *words("Actions"),
    ]
    with section("Tables for this controller"):
        with ui.element("div").classes("row"):
            command_button("Roll back to the table before", asked("rollback"), icon="undo", dangerous=True)
        figures(columns, map(row, one["tables"]), label="Tables")


def _run_link(run: str | None) -> None:
    if run and any(row["run"] == run for row in live_rows()):
        ui.link(run, f"/run/{quote(run)}/result")
    else:
        ui.label(run or "–")


@final
class _Difference:
    """The difference of two tables."""

    def __init__(self, one: dict[str, Any]) -> None:
        tables_ = {each["id"]: f"{short(each['id'])}, {shown_time(each['created'])}" for each in one["tables"]}
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
        from cellctl.operations.table_actions import known_table
        from cellctl.operations.table_diff import ComparedTable, table_difference

        def found() -> dict[str, Any]:
            pair = [ComparedTable.of_file(short(each), known_table(console().runs, each)) for each in (a, b)]
            return table_difference(pair[0], pair[1], None).to_json()

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


def _history(one: dict[str, Any]) -> None:
    columns = [*words("Since (UTC)", "Until", "Table", "Change, by whom"), *numbers("Rows"), *words("State")]
    rows = [
        [
            shown_time(each["time"]),
            shown_time(each["until"]),
            short(each["table"]),
            f"{each['action']}, {_by(each)}",
            str(each["rows"] or "–"),
            f"{each['state']}: {why}" if (why := each["out_of_force"] or each["reason"]) else each["state"],
        ]
        for each in one["changes"]
    ]
    with section("History", note="Every table that was put in force, by whom, when and from which run."):
        figures(columns, rows, label="History")


def _by(change: dict[str, Any]) -> str:
    return f"run {change['run']}, {change['who']}" if change["run"] else str(change["who"])
