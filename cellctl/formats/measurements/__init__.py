"""From robot file, data set and artefact to the task of an identification: rows of every kind, sessions, a model."""

from cellctl.formats.measurements.conditions import Conditions
from cellctl.formats.measurements.kinds import KINDS, NOUNS, Kind, measure_of
from cellctl.formats.measurements.measured import Measurements, measurements
from cellctl.formats.measurements.model_choice import ModelChoice, ModelTerms, nominal_model
from cellctl.formats.measurements.repeats import refuse_alike
from cellctl.formats.measurements.sessions import OWN, Spacing

__all__ = [
    "KINDS",
    "NOUNS",
    "OWN",
    "Conditions",
    "Kind",
    "Measurements",
    "ModelChoice",
    "ModelTerms",
    "Spacing",
    "measure_of",
    "measurements",
    "nominal_model",
    "refuse_alike",
]
