"""The dialog of a table action: cell, look at the controller, difference, typed confirmation, outcome."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, final

from nicegui import ui

from cellctl.console.commands import examinations
from cellctl.console.following import follow_event
from cellctl.console.job_view import JobView
from cellctl.console.jobs import Job
from cellctl.console.known_runs import live_rows
from cellctl.console.look import command_button, problem_list, state_word
from cellctl.console.shared import console
from cellctl.console.table_commands import request_for, start_action, start_look, why_busy
from cellctl.console.table_words import difference_words
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.operations.results import SIMULATOR_MEMORY
from cellctl.operations.run_list import RunRow, robot_serial
from cellctl.operations.shipped import shipped_names
from cellctl.operations.table_actions import Action, TableRequest, refuse_confirmation
from cellctl.operations.table_changes import short

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
        with ui.dialog().props("persistent") as self._dialog, ui.card().classes("table-action"):
            self._content = ui.element("div").classes("section wide")

    def close(self) -> None:
        """Close the dialog."""
        self._dialog.close()

    async def open(self, operator: Operator, action: Action, table: str, serial: str) -> None:
        """Begin `action` with the table of this id (empty: the one before) on the controller `serial`."""
        self._operator, self._action, self._table, self._serial = operator, action, table, serial
        self._content.clear()
        with self._content:
            ui.label(_TITLES[action].format(short(table))).classes("section-title")
            self._cell, self._memory = _cell_choice(serial)
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

    def _seen(self, found: dict[str, Any]) -> None:
        """What the controller has, and what would change; then the confirmation."""
        active = found["active"]
        word = f"in force: {short(active['id'])}, {active['rows']} rows" if active else "no table is in force"
        kind = "simulated controller" if found["simulated"] else "controller"
        ui.label(f"{kind} {found['serial']}: {word}")
        if found["record"]:
            state_word("warning", f"Not as recorded: {found['record']}")
        if found["refused"]:
            state_word("bad", "This table is refused for this controller:")
            for why in found["refused"]:
                ui.label(why)
            return
        if active and active["id"] == found["target"]:
            state_word("good", "This table is in force already: there is nothing to push.")
            return
        target = short(found["target"]) if found["target"] else "no table"
        ui.label(f"Afterwards in force: {target}").classes("section-title")
        if found["difference"]:
            difference_words(found["difference"])
        elif active and found["target"]:
            ui.label("The rows of one of the tables are not recorded here: their difference is not known.")
        self._confirmation(found, active["id"] if active else "")

    def _confirmation(self, found: dict[str, Any], seen: str) -> None:
        names = f"the controller's serial, {found['serial']}"
        if found["target"]:
            names += f", or the table's id, {short(found['target'])}"
        ui.label(f"To confirm, type {names}:")

        def wrong(text: str | None) -> str | None:
            try:
                refuse_confirmation(text or "", found["serial"], found["target"] or "")
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

    def _done(self, result: dict[str, Any]) -> None:
        if self._action == "verify":
            same = result["same"]
            word = f"in force, all {result['rows']} rows as in the file" if same else "not the table in force"
            state_word("good" if same else "bad", word, large=True)
            for text in result["differences"]:
                ui.label(text)
            return
        self._seen_view.clear()
        self._begin.clear()
        with self._begin:
            command_button("Close", self.close, important=True)
        if "verified" in result:
            word = f"Table {short(result['id'])} is in force on {result['serial']}: {result['rows']} rows, read back"
        else:
            word = (
                f"In force on {result['serial']}: {short(result['active']['id']) if result['active'] else 'no table'}"
            )
        state_word("good", word, large=True)
        if not result["recorded"]:
            state_word("warning", "The history of tables could not be written.")
        ui.timer(0.0, self._then, once=True)


def _each_job_and_examination(changed: Callable[[], None]) -> Callable[[], None]:
    ends = (console().jobs.subscribe(lambda _: changed()), examinations.add(changed))

    def end() -> None:
        for each in ends:
            each()

    return end


def _cell_choice(serial: str) -> tuple[ui.select, ui.select]:
    """The cell whose controller is meant, and for a simulated one the run whose memory it continues."""
    own = console().settings.cell
    names = {"": f"{own.stem} (this console's)"} if own else {}
    names |= {name: name for name in shipped_names("cell")}
    rows = [row for row in live_rows() if robot_serial(row) == serial and row.get("cell")]
    used = next((_stem(row["cell"]) for row in rows), "")
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


def _memories(rows: list[RunRow], cell: str) -> dict[str, str]:
    """Runs on the cell with this name that have a simulated controller's memory, the newest last."""
    own = [row["run"] for row in reversed(rows) if _stem(row["cell"]) == cell]
    return {"": "none: a new controller", **{run: run for run in own if _memory(run).is_file()}}


def _memory(run: str) -> Path:
    return console().runs / run / SIMULATOR_MEMORY


def _stem(cell: object) -> str:
    return Path(str(cell)).stem
