"""Fields for what an uploaded file may leave open, named as options of `cellctl import` and `cellctl convert`."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any, final

from nicegui import ui

from cellctl.console.look import command_button
from cellctl.files import Problem
from cellctl.robots import library

_CHOICES = {
    "unit": ("Unit of X, Y, Z", ["", "mm", "m", "cm", "um", "inch"]),
    "angles": ("Unit of the joints", ["", "deg", "rad"]),
    "decimal": ("Decimal sign", ["", "point", "comma"]),
    "pair": ("Pair two files by", ["", "name", "order"]),
    "orientation": ("Orientations are", ["", "abc", "quaternion", "fixed-xyz", "euler-xyz", "rotation-vector"]),
    "j3": ("Third joint counts from (FANUC)", ["", "horizontal", "arm"]),
}
_ROBOT = "Robot of the library"
_COLUMNS = "Columns of the file"
REPEATABILITY = "Repeatability of a URDF's robot, mm"
_LABELS = {name: label for name, (label, _) in _CHOICES.items()}
_LABELS |= {"robot": _ROBOT, "columns": _COLUMNS, "repeatability": REPEATABILITY}
_OPTION = re.compile(rf"--({'|'.join(_LABELS)})\b(?: MM\b)? *")


@final
class ImportAnswers:
    """The fields. `again`: reads the files again with these answers; its button appears once a file was refused."""

    def __init__(self, again: Callable[[], Any]) -> None:
        self._fields: dict[str, Any] = {}
        title = "Answers to questions of an import"
        self._all = ui.expansion(title).props("dense").classes("unfolding").style("width: 100%")
        with self._all:
            ui.label("Only for what the file leaves open.").classes("note")
            with ui.element("div").classes("answers"):
                for name, (label, options) in _CHOICES.items():
                    self._fields[name] = ui.select(options, value="", label=label).props("outlined dense")
                robots = ui.select(["", *library()], value="", label=_ROBOT, with_input=True)
                self._robot = robots.props("outlined dense")
                columns = ui.input(_COLUMNS, placeholder="A1=shoulder,A2=upper_arm,X=north").classes("wide")
                self._fields["columns"] = columns.props("outlined dense")
                self._fields["repeatability"] = ui.input(REPEATABILITY).props("outlined dense")
            self._again = command_button("Read the file again", again, icon="replay")
        self._again.set_visibility(False)

    @property
    def robot(self) -> str:
        """Name of the robot in the library; empty: not stated."""
        return str(self._robot.value or "")

    def texts(self) -> dict[str, str]:
        """The answers by option; those that are not stated are absent."""
        return {name: str(field.value).strip() for name, field in self._fields.items() if field.value}

    def ask(self) -> None:
        """Show the fields, and the button that reads the files again."""
        self._all.set_value(True)
        self._again.set_visibility(True)


def names_fields(problem: Problem) -> Problem:
    """The problem with the labels of the fields in place of options of the command line."""
    file, what, cure = (
        _OPTION.sub(lambda found: f"‘{_LABELS[found[1]]}’ ", text).strip()
        for text in (problem.file, problem.what, problem.cure)
    )
    return replace(problem, file=file, what=what, cure=cure)
