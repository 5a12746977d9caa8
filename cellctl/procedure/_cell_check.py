"""Finds the cell errors of each step before the run, from the inputs set by parameters alone."""

from __future__ import annotations

import pathlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, final

from cellctl.files import Document, InputError, Problem
from cellctl.procedure._steps import AnyStepKind, CellContext, StepDescription
from cellctl.procedure.model import Loop, Procedure, Step, walk
from cellctl.procedure.references import UNKNOWN, Reference, known_part, references_in
from cellctl.procedure.registry import StepRegistry


@final
@dataclass(frozen=True, slots=True)
class CellFiles:
    """A cell from its files, without opening a device."""

    cell: Document
    robot_file: pathlib.Path
    seed: int
    runs: pathlib.Path = pathlib.Path("runs")


def expected_passes(procedure: Procedure, parameters: Mapping[str, Any], registry: StepRegistry) -> int:
    """Total number of passes of the loops of `procedure`, predicted by its steps before the run.

    Raises InputError for a step whose `expects=` fails.
    """
    total = 0
    for action in procedure.actions():
        kind = registry.describe(action.do) if isinstance(action, Step) else None
        if isinstance(action, Step) and kind and kind.expects:
            with _own_mistakes(procedure, action, "expects"):
                total += kind.expects(_known(action, kind, parameters)) * _times(procedure, action.id)
    return total


def _times(procedure: Procedure, step: str) -> int:
    """How many loops have the one list that loops take from the results of `step`; 1 where they take several lists."""
    loops = (action for action in walk((*procedure.steps, *procedure.cleanup)) if isinstance(action, Loop))
    lists = [reference for loop in loops for _, reference in references_in(loop.for_each) if reference.name == step]
    return len(lists) if len(set(map(str, lists))) == 1 else 1


def check_cell(
    procedure: Procedure, parameters: Mapping[str, Any], registry: StepRegistry, context: CellContext
) -> list[Problem]:
    """The cell errors that the steps of `procedure` find; it must have no other error. Opens no device."""
    found: dict[Problem, None] = {}
    for action in procedure.actions():
        kind = registry.find(action.do) if isinstance(action, Step) else None
        if isinstance(action, Step) and kind and kind.check:
            try:
                with _own_mistakes(procedure, action, "check"):
                    kind.check(context, _known(action, kind, parameters))
            except InputError as error:
                found |= dict.fromkeys(error.problems)  # several steps find the same error
    try:
        expected_passes(procedure, parameters, registry)
    except InputError as error:
        found |= dict.fromkeys(error.problems)
    return list(found)


@contextmanager
def _own_mistakes(procedure: Procedure, step: Step, hook: str) -> Iterator[None]:
    """Turn an error of a step's own `check=` or `expects=` into one at the step: other people write steps too."""
    try:
        yield
    except (InputError, OSError):
        raise
    except Exception as error:
        what = f"`{hook}=` of step {step.do} failed: {type(error).__name__}: {error}"
        cure = "report it to the step's author"
        raise InputError(procedure.document.problem((*step.at, "do"), what, cure)) from error


def _known(step: Step, kind: AnyStepKind | StepDescription, parameters: Mapping[str, Any]) -> dict[str, Any]:
    def value_of(reference: Reference) -> Any:
        return UNKNOWN if reference.way else parameters.get(reference.name, UNKNOWN)

    fields = kind.inputs.model_fields.items()
    defaults = {name: field.get_default() for name, field in fields if not field.is_required()}
    known, unknown = known_part(step.inputs, value_of)
    for path in unknown:
        defaults.pop(str(path[0]), None)
    return {**defaults, **known}
