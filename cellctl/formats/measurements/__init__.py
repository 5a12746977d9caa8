"""From robot file, data set and artefact to the task of an identification: rows of every kind, sessions, a model."""

from cellctl.formats.measurements._conditions import Conditions
from cellctl.formats.measurements._measured import Measurements, measurements, refuse_alike, tolerances_of
from cellctl.formats.measurements._model_choice import ModelChoice, ModelTerms, nominal_model
from cellctl.formats.measurements._rows import Reading
from cellctl.formats.measurements._sessions import OWN, Spacing
from cellctl.formats.measurements.columns import distance_sigma
from cellctl.formats.measurements.kinds import KINDS, Kind, RowKind, measure_of

__all__ = [
    "KINDS",
    "OWN",
    "Conditions",
    "Kind",
    "Measurements",
    "ModelChoice",
    "ModelTerms",
    "Reading",
    "RowKind",
    "Spacing",
    "distance_sigma",
    "measure_of",
    "measurements",
    "nominal_model",
    "refuse_alike",
    "tolerances_of",
]
