"""Fields for the parameters of a procedure: type, limits, unit and default beside each, errors below it."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from nicegui import ui

from cellctl.operations.checking import ProcedureForm, setting_problem
from cellctl.procedure import Parameter, ParameterType, Procedure

_KEYBOARDS = {ParameterType.INTEGER: "numeric", ParameterType.NUMBER: "decimal"}


@final
class ParameterFields:
    """A row for each parameter. `changed` is called after each change."""

    def __init__(self, form: ProcedureForm, procedure: Procedure, changed: Callable[[], None]) -> None:
        self._procedure, self._changed = procedure, changed
        self._given: dict[str, str] = {}
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
        if parameter.type is ParameterType.FLAG:
            box = ui.checkbox(
                value=bool(default), on_change=lambda event: self._set(parameter, str(event.value).lower())
            )
            box.props(f"dense {label}")
        elif parameter.choices:
            chosen = ui.select(
                list(parameter.choices), value=default, on_change=lambda event: self._set(parameter, event.value or "")
            )
            chosen.props(f"outlined dense options-dense {label}")
        else:
            field = ui.input(
                value=text_of(default),
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
