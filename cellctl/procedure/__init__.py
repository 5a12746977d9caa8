"""Procedures: the steps of a campaign, read from a file and checked completely before any motion."""

from cellctl.procedure.cell_check import CellContext, CellFiles, check_cell, expected_passes
from cellctl.procedure.check import DeviceConditions, Devices, check, checked_parameters
from cellctl.procedure.context import StepContext
from cellctl.procedure.expressions import Expression
from cellctl.procedure.inputs import inputs_of
from cellctl.procedure.loader import load_procedure, read_procedure
from cellctl.procedure.model import (
    Action,
    Confirm,
    If,
    Interlock,
    Loop,
    OnBreak,
    OnResume,
    Parameter,
    ParameterType,
    Procedure,
    Resume,
    Retry,
    Step,
    step_path,
    walk,
)
from cellctl.procedure.parameters import resolve_parameters
from cellctl.procedure.phases import phase_titles
from cellctl.procedure.references import Reference, UnresolvedReference, resolve
from cellctl.procedure.registry import BrokenSteps, StepRegistry, UnknownStep
from cellctl.procedure.section import section_of
from cellctl.procedure.steps import AnyStepKind, NoInputs, StepInputs, StepKind, StepResult, step

__all__ = [
    "Action",
    "AnyStepKind",
    "BrokenSteps",
    "CellContext",
    "CellFiles",
    "Confirm",
    "DeviceConditions",
    "Devices",
    "Expression",
    "If",
    "Interlock",
    "Loop",
    "NoInputs",
    "OnBreak",
    "OnResume",
    "Parameter",
    "ParameterType",
    "Procedure",
    "Reference",
    "Resume",
    "Retry",
    "Step",
    "StepContext",
    "StepInputs",
    "StepKind",
    "StepRegistry",
    "StepResult",
    "UnknownStep",
    "UnresolvedReference",
    "check",
    "check_cell",
    "checked_parameters",
    "expected_passes",
    "inputs_of",
    "load_procedure",
    "phase_titles",
    "read_procedure",
    "resolve",
    "resolve_parameters",
    "section_of",
    "step",
    "step_path",
    "walk",
]
