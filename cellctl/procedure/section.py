"""The fields of a procedure's result besides the common ones."""

from __future__ import annotations

from cellctl.procedure.model import Procedure, Step, walk
from cellctl.procedure.registry import StepRegistry


def section_of(procedure: Procedure, registry: StepRegistry) -> tuple[str, ...]:
    """The fields of the verdict rows that its steps record, each once, in order. Raises UnknownStep, BrokenSteps."""
    kinds = [registry.find(action.do) for action in walk(procedure.steps) if isinstance(action, Step)]
    return tuple(dict.fromkeys(name for kind in kinds if kind.verdict for name in kind.verdict.SECTION))
