"""The place of a run's step in its procedure, and the values that it can refer to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.procedure.model import Action, If, Loop, Procedure, Step, step_path
from cellctl.procedure.references import resolve


def step_at(
    procedure: Procedure, path: str, parameters: Mapping[str, Any], finished: Mapping[str, Any]
) -> tuple[Step, dict[str, Any]]:
    """The step at `path` (`points[17].touch`), and the values that it can refer to: name → JSON.

    parameters: their values; finished: path → result of the steps that are done, and of the `if`s that are decided.
    Raises LookupError if the procedure has no such step, or an `if` around it is not decided.
    """
    scope, outer = dict(parameters), ""
    actions: tuple[Action, ...] = procedure.steps
    first, _, rest = path.partition(".")
    if first == "cleanup" and rest and all(action.id != first for action in actions):
        actions, path, outer = procedure.cleanup, rest, first
    for part in path.split("."):
        name, _, index = part.rstrip("]").partition("[")
        action = _found(actions, name, outer, finished, scope)
        outer = step_path(outer, part)
        if isinstance(action, Step):
            return action, scope
        if isinstance(action, Loop):
            scope[action.variable] = resolve(action.for_each, scope)[int(index)]
            actions = action.steps
        if isinstance(action, If):
            actions = action.then if finished[outer]["value"] else action.otherwise
    raise LookupError(f"{path} is no step")


def _found(
    actions: tuple[Action, ...], name: str, outer: str, finished: Mapping[str, Any], scope: dict[str, Any]
) -> Action:
    """The action called `name`; the results of the steps before it are added to `scope`."""
    for action in actions:
        if action.id == name:
            return action
        path = step_path(outer, action.id)
        if isinstance(action, Step) and path in finished:
            scope[action.id] = finished[path]
    raise LookupError(f"there is no '{name}' in the procedure")
