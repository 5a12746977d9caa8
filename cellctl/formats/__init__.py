"""Conversion between files and the pure packages: robots, artefacts, data sets, models, tables. NumPy loads on
demand.
"""

from cellctl.formats._installed import add_installed
from cellctl.formats._prior import from_prior, only
from cellctl.formats.artefact import Artefact, Sphere, artefact_of, load_artefact
from cellctl.formats.cell_sections import (
    Currents,
    FlangeReflector,
    Nest,
    currents_of,
    floor_of,
    postures_of,
    reflectors_of,
    station_of,
)
from cellctl.formats.dataset import DataSet, Rejected, Sieve, joint_readings
from cellctl.formats.description import plain_number
from cellctl.formats.design_problem import candidate_rows, design_problem
from cellctl.formats.fit_report import fit_report, sentence
from cellctl.formats.load import Load, load_of
from cellctl.formats.measurements import (
    Kind,
    Measurements,
    ModelChoice,
    ModelTerms,
    Reading,
    RowKind,
    distance_sigma,
    measurements,
    nominal_model,
)
from cellctl.formats.measurements.columns import SIGMA_COLUMNS
from cellctl.formats.model import ModelFile
from cellctl.formats.online import CorrectionFile
from cellctl.formats.table import TableFile, row_problems, table_problems
from cellctl.formats.table_making import compensated_targets, nominal_chain, table_of, target_rows, valid_region
from cellctl.robot_file import RobotFile

__all__ = [
    "SIGMA_COLUMNS",
    "Artefact",
    "CorrectionFile",
    "Currents",
    "DataSet",
    "FlangeReflector",
    "Kind",
    "Load",
    "Measurements",
    "ModelChoice",
    "ModelFile",
    "ModelTerms",
    "Nest",
    "Reading",
    "Rejected",
    "RobotFile",
    "RowKind",
    "Sieve",
    "Sphere",
    "TableFile",
    "artefact_of",
    "candidate_rows",
    "compensated_targets",
    "currents_of",
    "design_problem",
    "distance_sigma",
    "fit_report",
    "floor_of",
    "from_prior",
    "joint_readings",
    "load_artefact",
    "load_of",
    "measurements",
    "nominal_chain",
    "nominal_model",
    "only",
    "plain_number",
    "postures_of",
    "reflectors_of",
    "row_problems",
    "sentence",
    "station_of",
    "table_of",
    "table_problems",
    "target_rows",
    "valid_region",
]

add_installed()
