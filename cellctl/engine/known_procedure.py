"""The procedure of a run, read from its journal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, final

from cellctl.files import InputError, parse_yaml
from cellctl.journal import RunStarted
from cellctl.procedure import (
    BrokenSteps,
    Confirm,
    Loop,
    Procedure,
    Step,
    StepRegistry,
    UnknownStep,
    expected_passes,
    phase_titles,
    read_procedure,
)


@final
@dataclass(frozen=True, slots=True)
class KnownProcedure:
    """`titles`: action id → its own title; `phases`: step id → title of its phase; `expected`: see `Passes`."""

    procedure: Procedure
    titles: Mapping[str, str]
    phases: Mapping[str, str]
    expected: int

    @classmethod
    def of(cls, started: RunStarted, registry: StepRegistry) -> Self | None:
        """The procedure of a started run; None if it was written by a version with other rules.

        Of steps whose package is not installed here only the ids are known.
        """
        try:
            procedure = read_procedure(parse_yaml(started.procedure.text, started.procedure.path))
        except InputError:
            return None
        titles = _titles(procedure, registry)
        try:
            expected = expected_passes(procedure, started.parameters, registry)
            return cls(procedure, titles, phase_titles(procedure, registry), expected)
        except (UnknownStep, BrokenSteps):
            return cls(procedure, titles, {}, 0)
        except InputError:
            return None


def _title_of_kind(do: str, registry: StepRegistry) -> str:
    try:
        return registry.find(do).title
    except (UnknownStep, BrokenSteps):
        return ""


def _titles(procedure: Procedure, registry: StepRegistry) -> dict[str, str]:
    titles = {}
    for action in procedure.actions():
        match action:
            case Confirm(text=text):
                title = text
            case Loop(title=title):
                pass
            case Step(do=do):
                title = _title_of_kind(do, registry)
            case _:
                title = ""
        titles[action.id] = title or action.id.replace("_", " ")
    return titles
