"""How alike errors of nearby postures are: correlation of distances, semivariograms. Pure: arrays in, arrays out."""

from cellctl.analysis.similarity import Correlation, ErrorSet, Similarity, UnsuitableRows, mantel, similarity
from cellctl.error_maps.kriging import EmpiricalSemivariogram, SemivariogramModel, fitted_model, semivariogram

__all__ = [
    "Correlation",
    "EmpiricalSemivariogram",
    "ErrorSet",
    "SemivariogramModel",
    "Similarity",
    "UnsuitableRows",
    "fitted_model",
    "mantel",
    "semivariogram",
    "similarity",
]
