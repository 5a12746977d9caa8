"""How alike errors of nearby postures are: correlation of distances, semivariograms. Pure: arrays in, arrays out."""

from cellctl.analysis.similarity import Correlation, ErrorSet, Similarity, UnsuitableRows, mantel, similarity
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
