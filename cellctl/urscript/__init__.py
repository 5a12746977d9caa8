"""URScript, the language of Universal Robots' controllers: programs read without loss."""

from cellctl.urscript._grammar import (
    Assignment,
    Branches,
    Evaluation,
    Function,
    Leaving,
    Loop,
    Statement,
    Unknown,
    statements,
)
from cellctl.urscript._script_file import ScriptFile, every
from cellctl.urscript.expressions import Call, Elements, Expression, Name, Number, Other, calls, within

__all__ = [
    "Assignment",
    "Branches",
    "Call",
    "Elements",
    "Evaluation",
    "Expression",
    "Function",
    "Leaving",
    "Loop",
    "Name",
    "Number",
    "Other",
    "ScriptFile",
    "Statement",
    "Unknown",
    "calls",
    "every",
    "statements",
    "within",
]
