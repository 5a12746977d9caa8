"""How alike errors of nearby postures are: correlation of distances, semivariograms. Pure: arrays in, arrays out."""

from cellctl.analysis.correlation import Correlation, mantel
from cellctl.analysis.errors import ErrorSet, UnsuitableRows
from cellctl.analysis.similarity import Similarity, similarity
from cellctl.error_maps.kriging import EmpiricalSemivariogram, GaussianSemivariogram, fit_gaussian, semivariogram

__all__ = [
    "Correlation",
    "EmpiricalSemivariogram",
    "ErrorSet",
    "GaussianSemivariogram",
    "Similarity",
    "UnsuitableRows",
    "fit_gaussian",
    "mantel",
    "semivariogram",
    "similarity",
]
