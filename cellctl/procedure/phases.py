"""The phase titles of a procedure, shown to the operator while a step runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.procedure.model import Action, If, Loop, Procedure, Step

if TYPE_CHECKING:
    from cellctl.procedure.registry import StepRegistry


def phase_titles(procedure: Procedure, registry: StepRegistry) -> dict[str, str]:
    """Step id → its phase: the title of the innermost loop around it that has one, else of its kind, else its id."""
    titles: dict[str, str] = {}
    _collect((*procedure.steps, *procedure.cleanup), "", registry, titles)
    return titles


def _collect(actions: tuple[Action, ...], around: str, registry: StepRegistry, titles: dict[str, str]) -> None:
    for action in actions:
        match action:
            case Loop():
                _collect(action.steps, action.title or around, registry, titles)
            case If():
                _collect((*action.then, *action.otherwise), around, registry, titles)
            case Step():
                titles[action.id] = around or registry.find(action.do).title or action.id.replace("_", " ")
