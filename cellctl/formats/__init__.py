"""Conversion between files and the pure packages: robots, artefacts, data sets, models, tables. NumPy loads on
demand.
"""

from cellctl.formats._installed import add_installed
from cellctl.formats._prior import from_prior, only
from cellctl.formats.artefact import Artefact, artefact_of, load_artefact
from cellctl.formats.cell_sections import postures_of
from cellctl.formats.dataset import DataSet, Rejected
from cellctl.formats.fit_report import fit_report, sentence
from cellctl.formats.measurements import Measurements, measurements, nominal_model
from cellctl.formats.model import ModelFile
from cellctl.formats.table import TableFile, table_problems
from cellctl.formats.table_making import compensated_targets, table_of
from cellctl.robot_file import RobotFile

__all__ = [
    "Artefact",
    "DataSet",
    "Measurements",
    "ModelFile",
    "Rejected",
    "RobotFile",
    "TableFile",
    "artefact_of",
    "compensated_targets",
    "fit_report",
    "from_prior",
    "load_artefact",
    "measurements",
    "nominal_model",
    "only",
    "postures_of",
    "sentence",
    "table_of",
    "table_problems",
]

add_installed()
