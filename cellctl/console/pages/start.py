"""`/start`: procedure and cell, fields for parameters, the check, then a run that lives on without the console."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import final
from urllib.parse import quote

from nicegui import ui

from cellctl.console import commands
from cellctl.console.appearance import command_button, facts, problem_list, section, shown_time, state_word
from cellctl.console.frame import Commands, answer_of, enable, frame, operator
from cellctl.console.pages.planning import Plan, asked_plan
from cellctl.console.run_queue import Planned
from cellctl.console.shared import console
from cellctl.devices.cell import ClockMode
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.operations.checking import (
    Checked,
    FileChoice,
    ProcedureForm,
    check,
    choices,
    first_choice,
    form_of,
    line_of,
    missing_devices,
    setting_problem,
)
from cellctl.operations.presets import presets_of
from cellctl.operations.run_control import RunOrder
from cellctl.procedure import Parameter, ParameterType, Procedure, load_procedure
from cellctl.procedure.registry import BrokenSteps

_KEYBOARDS = {ParameterType.INTEGER: "numeric", ParameterType.NUMBER: "decimal"}


@final
class ParameterFields:
    """A row for each parameter. `changed` is called after each change."""

    def __init__(
        self, form: ProcedureForm, procedure: Procedure, changed: Callable[[], None], given: Mapping[str, str]
    ) -> None:
        self._procedure, self._changed = procedure, changed
        self._given = {name: text for name, text in given.items() if name in form.parameters}
        self._wrong: set[str] = set()
        if not form.parameters:
            ui.label("This procedure has no parameters.")
            return
        with ui.element("div").classes("scrolling"), ui.element("table").classes("figures parameters"):
            with ui.element("thead"), ui.element("tr"):
                for title, words in (("Parameter", True), ("Value", True), ("Limits", False), ("Unit", True)):
                    with ui.element("th").classes("words" * words).props("scope=col"):
                        ui.label(title)
            with ui.element("tbody"):
                for parameter in form.parameters.values():
                    self._row(parameter)

    @property
    def valid(self) -> bool:
        """Whether each value has its type and is within its limits."""
        return not self._wrong

    def given(self) -> dict[str, str]:
        """Each value that was given, by its parameter."""
        return dict(self._given)

    def settings(self) -> list[str]:
        """`name=value` of each value that was given."""
        return [f"{name}={text}" for name, text in self._given.items()]

    def _row(self, parameter: Parameter) -> None:
        with ui.element("tr"):
            with ui.element("td").classes("words"):
                ui.label(parameter.name).classes("mono")
                ui.label(parameter.help).classes("note")
            with ui.element("td").classes("words value"):
                self._field(parameter)
            with ui.element("td"):
                ui.label(limits_of(parameter))
            with ui.element("td").classes("words"):
                ui.label(parameter.unit)

    def _field(self, parameter: Parameter) -> None:
        name, default = parameter.name, parameter.default
        label = f'aria-label="{name}"'
        now = self._given.get(name, text_of(default))
        if self._error(parameter, now):
            self._wrong.add(name)
        if parameter.type is ParameterType.FLAG:
            box = ui.checkbox(
                value=now == "true", on_change=lambda event: self._set(parameter, str(event.value).lower())
            )
            box.props(f"dense {label}")
        elif parameter.choices:
            chosen = ui.select(
                list(parameter.choices),
                value=self._given.get(name, default),
                on_change=lambda event: self._set(parameter, event.value or ""),
            )
            chosen.props(f"outlined dense options-dense {label}")
        else:
            field = ui.input(
                value=now,
                placeholder="required" if default is None else text_of(default),
                on_change=lambda event: self._set(parameter, event.value or ""),
                validation=lambda text: self._error(parameter, text),
            )
            field.props(f"outlined dense hide-bottom-space {label}").props(
                f"inputmode={_KEYBOARDS.get(parameter.type, 'text')}"
            )

    def _set(self, parameter: Parameter, text: str) -> None:
        name = parameter.name
        if text.strip() in ("", text_of(parameter.default)):
            self._given.pop(name, None)
        else:
            self._given[name] = text.strip()
        (self._wrong.add if self._error(parameter, text) else self._wrong.discard)(name)
        self._changed()

    def _error(self, parameter: Parameter, text: str) -> str | None:
        """Why `text` is wrong, in one line; None: it is valid, or empty for the default."""
        if not (text or "").strip():
            return "a value is required" if parameter.default is None else None
        found = setting_problem(self._procedure, parameter.name, text.strip())
        return f"{found.what}; {found.cure}" if found else None


def limits_of(parameter: Parameter) -> str:
    """`18 … 2000`, `≥ 0`; empty without limits."""
    low, high = parameter.min, parameter.max
    if low is not None and high is not None:
        return f"{low:g} … {high:g}"
    if low is not None:
        return f"≥ {low:g}"
    return "" if high is None else f"≤ {high:g}"


def text_of(value: float | str | bool | None) -> str:
    """A default as an operator types it."""
    if isinstance(value, bool) or value is None:
        return "" if value is None else str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


_took: dict[str, float] = {}
"""How long the latest work of each kind took, s."""


@final
class _Progress:
    """A bar with the seconds, in proportion to how long this work took the last time; unseen while nothing is done."""

    def __init__(self) -> None:
        with ui.element("div").classes("run-progress") as self._row:
            self._bar = ui.linear_progress(0.0, show_value=False).props('instant-feedback aria-label="Progress"')
            self._text = ui.label()
        self._row.set_visibility(False)
        self._timer = ui.timer(0.5, self._show, active=False)

    @contextmanager
    def of(self, work: str) -> Iterator[None]:
        """Shown inside this context."""
        self._began, self._usual = asyncio.get_running_loop().time(), _took.get(work)
        self._bar.props(
            "indeterminate" if self._usual is None else "", remove="" if self._usual is None else "indeterminate"
        )
        self._row.set_visibility(True)
        self._timer.activate()
        try:
            yield
            _took[work] = asyncio.get_running_loop().time() - self._began
        finally:
            self._timer.deactivate()
            self._row.set_visibility(False)

    def _show(self) -> None:
        over = asyncio.get_running_loop().time() - self._began
        usual = f" of about {self._usual:.0f}" if self._usual and over < self._usual else ""
        self._text.set_text(f"{over:.0f}{usual} s")
        if self._usual:
            self._bar.set_value(min(over / self._usual, 0.98))


_CLOCKS = {"": "as the cell file states", "lockstep": "lockstep: as fast as it can", "realtime": "real time"}


@ui.page("/start", response_timeout=30.0)
async def start(procedure: str = "", cell: str = "", preset: str = "") -> None:
    """The form for a procedure and a cell, filled in by a preset.

    Default: a procedure for the console's cell, and that cell or the procedure's own.
    """
    procedures = await asyncio.to_thread(choices, "procedure")
    cells = await asyncio.to_thread(choices, "cell", console().settings.cell)
    given = console().settings.cell
    chosen = procedures.get(procedure) or first_choice(procedures, cell or (given.stem if given else ""))
    with frame("Start a run", "/start"):
        try:
            form = await asyncio.to_thread(form_of, chosen.file)
        except InputError as error:
            _selects(procedures, cells, chosen, "")
            problem_list(error.problems)
            return
        usual = (cell, given.stem if given else "", form.cell.stem if form.cell else "")
        offered = [name for name in dict.fromkeys(usual) if name in cells] or [next(iter(cells))]
        named = cell in cells
        place, missing = await asyncio.to_thread(_first_fitting, form.file, [cells[name] for name in offered], named)
        _selects(procedures, cells, chosen, place.name)
        _StartPage(form, place, missing, preset)


def _first_fitting(procedure: Path, cells: Sequence[FileChoice], named: bool) -> tuple[FileChoice, tuple[str, ...]]:
    """The first cell with the devices of the procedure, else the first one; what it lacks. named: by a person."""

    def missing(cell: FileChoice) -> tuple[str, ...]:
        try:
            return missing_devices(procedure, cell.file)
        except (InputError, LookupError, ValueError, BrokenSteps):  # the check reports it, at its line
            return ()

    first = cells[0], missing(cells[0])
    if named or not first[1]:
        return first
    return next(((cell, ()) for cell in cells[1:] if not missing(cell)), first)


def _selects(procedures: dict[str, FileChoice], cells: dict[str, FileChoice], chosen: FileChoice, cell: str) -> None:
    def go() -> None:
        if procedure.value and place.value:
            ui.navigate.to(f"/start?procedure={procedure.value}&cell={place.value}")

    with ui.element("div").classes("row"):
        names = {name: f"{one.title} ({name})" for name, one in procedures.items()}
        procedure = ui.select(names, value=chosen.name, label="Procedure", with_input=True, on_change=lambda: go())
        procedure.props("outlined dense options-dense").style("min-width: min(34rem, 100%)")
        titles = {name: f"{one.title} ({name}), {_kind(one)}" for name, one in cells.items()}
        place = ui.select(titles, value=cell or None, label="Cell", with_input=True, on_change=lambda: go())
        place.props("outlined dense options-dense").style("min-width: min(26rem, 100%)")


def _kind(cell: FileChoice) -> str:
    return "simulated" if cell.simulated else "REAL"


@final
class _StartPage:
    """The form below the choice of procedure and cell. A run can be started once its check found no error."""

    def __init__(self, form: ProcedureForm, cell: FileChoice, missing: Sequence[str], preset: str) -> None:
        self._form, self._cell, self._missing = form, cell, missing
        with ui.element("div").classes("start-columns"):
            with section("Parameters", note="Empty or unchanged fields keep the default."):
                given = self._presets(preset)
                self._fields = ParameterFields(form, load_procedure(form.file), self._changed, given)
                self._further()
            with section("Check and start").classes("start-part"):
                self._cautions()
                with ui.element("div").classes("row"):
                    self._check = command_button("Check", self._on_check, icon="rule", gives="check")
                    self._start = command_button(
                        "Start the run", self._on_start, icon="play_arrow", important=True, gives="start"
                    )
                    self._plan = command_button("Plan …", self._on_plan, icon="schedule", gives="queue")
                self._working = ui.label().classes("note").props("role=status")
                self._progress = _Progress()
                self._commands = Commands()
                self._result = ui.element("div").classes("section").props("aria-live=polite")
                self._about()
        self._changed()

    def _further(self) -> None:
        with ui.expansion("Seed and time").props("dense").classes("further"), ui.element("div").classes("row"):
            self._seed = ui.input("Seed", on_change=lambda: self._changed()).props("outlined dense clearable")
            self._seed.props('inputmode=numeric hint="Default: the cell file\'s"')
            self._clock = ui.select(_CLOCKS, value="", label="Time of a simulated cell", on_change=self._changed)
            self._clock.props("outlined dense options-dense").style("min-width: 16rem")
            self._clock.set_enabled(bool(self._cell.simulated))

    def _presets(self, chosen: str) -> Mapping[str, str]:
        """The choice of a preset, and keeping one; the settings of the chosen one."""
        name, place = (
            self._form.file.stem,
            f"/start?procedure={quote(self._form.file.stem)}&cell={quote(self._cell.name)}",
        )
        refused = ui.element("div").classes("when-filled")
        try:
            known = presets_of(console().runs, name)
        except InputError as error:
            known = {}
            with refused:
                problem_list(error.problems)
        commands_ = Commands()

        async def change(title: str, settings: Mapping[str, str] | None) -> None:
            async def work(operator: Operator) -> None:
                await commands.change_presets(operator, name, title, settings)
                ui.navigate.to(place if settings is None else f"{place}&preset={quote(' '.join(title.split()))}")

            await commands_.give(work)

        async def keep() -> None:
            with ui.dialog().props('aria-label="Keep a preset"') as dialog, ui.card():
                ui.label("Keep these parameters as a preset").classes("section-title")
                title = ui.input("Name", value=chosen).props("outlined dense autofocus").classes("wide")
                with ui.element("div").classes("row"):
                    command_button("Keep", lambda: dialog.submit(True), important=True)
                    command_button("Cancel", lambda: dialog.submit(False))
            if await answer_of(dialog):
                await change(title.value or "", self._fields.given())

        with ui.element("div").classes("row"):
            options = {"": "none: the procedure's defaults", **{each: each for each in known}}
            choice = ui.select(options, value=chosen if chosen in known else "", label="Preset")
            choice.on_value_change(
                lambda event: ui.navigate.to(f"{place}&preset={quote(event.value)}" if event.value else place)
            )
            choice.props("outlined dense options-dense").style("min-width: 16rem")
            command_button("Keep as preset …", keep, icon="bookmark_add", gives="keep preset")
            if chosen in known:
                command_button("Delete preset", lambda: change(chosen, None), icon="delete", gives="delete preset")
        if chosen in known:
            ui.label(f"Kept by {known[chosen].operator}, {shown_time(known[chosen].time)}.").classes("note")
        return known[chosen].settings if chosen in known else {}

    def _about(self) -> None:
        form, cell = self._form, self._cell
        rows = [("Procedure", f"{form.title} ({form.file})"), ("Cell", f"{cell.title}, {_kind(cell)} ({cell.file})")]
        facts([*rows, *(("You will confirm", text) for text in form.confirms)])

    def _cautions(self) -> None:
        if self._cell.simulated is False:
            state_word("warning", "The robot of a real cell will move.")
        for what in self._missing:
            state_word("bad", f"This cell does not do for the procedure: it needs {what}. Choose another cell.")

    def _changed(self) -> None:
        """The form is not the one that was checked."""
        self._result.clear()
        enable(self._start, False)
        enable(self._plan, False)
        enable(self._check, self._fields.valid)
        self._working.set_text("Check first: nothing moves." if self._fields.valid else "Correct the marked fields.")

    def _order(self) -> RunOrder:
        seed = (self._seed.value or "").strip()
        if seed and not seed.isdecimal():
            raise InputError(Problem("seed", 0, 0, f"'{seed}' is no seed", "give a whole number from 0, or nothing"))
        clock: ClockMode | None = self._clock.value or None
        settings = tuple(self._fields.settings())
        return RunOrder(self._form.file, self._cell.file, settings, int(seed) if seed else None, clock)

    async def _on_check(self) -> None:
        self._changed()
        enable(self._check, False)
        self._working.set_text("Checking procedure, cell and parameters …")
        try:
            console().sessions.refuse(operator(), "check")
            order = self._order()
            with self._progress.of(f"check of {order.procedure}"):
                found = await check(order.procedure, order.cell, order.settings, console().runs)
            if order != self._order():
                return  # the form was changed meanwhile
        except InputError as error:
            found = Checked(tuple(error.problems))
        enable(self._check, True)
        self._show(found)
        enable(self._start, not found.problems)
        enable(self._plan, not found.problems)

    def _show(self, found: Checked) -> None:
        self._result.clear()
        number = len(found.problems)
        self._working.set_text("" if number else "Start the run when the cell is ready.")
        with self._result:
            if number:
                state_word("bad", f"{number} error{'s' * (number > 1)}: the run cannot start")
                problem_list(found.problems, line_of)
            else:
                state_word("good", f"No errors. Cell '{found.cell}': {', '.join(found.devices)}.")
            if found.warnings:
                state_word("warning", "Allowed, but probably not intended:")
                problem_list(found.warnings, line_of)

    async def _on_start(self) -> None:
        if self._cell.simulated:
            await self._commands.give(self._begin)
            return
        with ui.dialog().props('aria-label="Start on the real cell"') as dialog, ui.card():
            ui.label(f"Start on the real cell '{self._cell.title}'?").classes("section-title")
            ui.label("The robot will move. Nobody may be inside the guard.")
            with ui.element("div").classes("row"):
                command_button("Start the run", lambda: dialog.submit(True), important=True)
                command_button("Cancel", lambda: dialog.submit(False))
        if await answer_of(dialog):
            await self._commands.give(self._begin)

    async def _on_plan(self) -> None:
        if (plan := await asked_plan()) is not None:
            await self._commands.give(lambda operator: self._planned(operator, plan))

    async def _planned(self, operator: Operator, plan: Plan) -> None:
        order = self._order()
        settings = dict(setting.split("=", 1) for setting in order.settings)
        await plan.give(operator, Planned(self._form.file.stem, self._cell.name, settings, order.seed, order.clock))
        ui.navigate.to("/jobs")

    async def _begin(self, operator: Operator) -> None:
        enable(self._start, False)
        self._working.set_text("Starting: the run checks once more in its own process, and connects to its devices …")
        try:
            with self._progress.of(f"start of {self._form.file}"):
                name = await commands.start(operator, self._order())
        except BaseException:
            self._changed()
            raise
        ui.navigate.to(f"/run/{name}")
