"""Rows of the journal as classes: what steps record, and what every reader reads."""

from cellctl.records.artefact import ArtefactRow
from cellctl.records.identification import IdentificationRow, ResidualsRow
from cellctl.records.row import AnyRow, BadRow, Json, Row, Rows
from cellctl.records.table import TablePushRow, TableStateRow
from cellctl.records.verdict import Figures, VerdictRow

__all__ = [
    "AnyRow",
    "ArtefactRow",
    "BadRow",
    "Figures",
    "IdentificationRow",
    "Json",
    "ResidualsRow",
    "Row",
    "Rows",
    "TablePushRow",
    "TableStateRow",
    "VerdictRow",
]
