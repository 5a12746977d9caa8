"""What steps of campaigns use of the services: tables, set-up errors, agreement of models, earlier runs."""

from cellctl.operations.agreement import models_agree
from cellctl.operations.compensating import (
    CellRobot,
    ModelController,
    refuse_model,
    refuse_other_cell,
    stated_controller,
)
from cellctl.operations.run_indexing import runs_to_compare
from cellctl.operations.setup_refusals import SetupFiles, refuse_setup_errors
from cellctl.operations.table import TableRecorder, active_id, in_force, push_verified, refuse_table, roll_back
from cellctl.operations.table_history import TableHistory

__all__ = [
    "CellRobot",
    "ModelController",
    "SetupFiles",
    "TableHistory",
    "TableRecorder",
    "active_id",
    "in_force",
    "models_agree",
    "push_verified",
    "refuse_model",
    "refuse_other_cell",
    "refuse_setup_errors",
    "refuse_table",
    "roll_back",
    "runs_to_compare",
    "stated_controller",
]
