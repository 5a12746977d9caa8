"""Files ↔ what the pure rooms work on: robots, artefacts, data sets, models. NumPy loads when arrays are asked for."""

from cellctl.formats.artefact import Artefact, artefact_of, load_artefact
from cellctl.formats.dataset import DataSet, Rejected
from cellctl.formats.fit_report import fit_report, sentence
from cellctl.formats.measurements import Measurements, measurements, nominal_model
from cellctl.formats.model import ModelFile
from cellctl.formats.robot import RobotFile

__all__ = [
    "Artefact",
    "DataSet",
    "Measurements",
    "ModelFile",
    "Rejected",
    "RobotFile",
    "artefact_of",
    "fit_report",
    "load_artefact",
    "measurements",
    "nominal_model",
    "sentence",
]
