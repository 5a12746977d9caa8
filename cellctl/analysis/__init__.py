"""How alike errors of nearby postures are: correlation of distances, semivariograms. Pure: arrays in, arrays out."""

from cellctl.analysis.correlation import Correlation, mantel
from cellctl.analysis.errors import ErrorSet, UnsuitableRows
from cellctl.analysis.semivariogram import GaussianModel, Semivariogram, fit_gaussian, semivariogram
from cellctl.analysis.similarity import Similarity, similarity

__all__ = [
    "Correlation",
    "ErrorSet",
    "GaussianModel",
    "Semivariogram",
    "Similarity",
    "UnsuitableRows",
    "fit_gaussian",
    "mantel",
    "semivariogram",
    "similarity",
]
