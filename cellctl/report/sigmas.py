"""The table that explains every σ on a page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final


@final
@dataclass(frozen=True, slots=True)
class Sigma:
    """A σ by its name on the page: its contents, its computation, and its level (1 σ, or the share covered)."""

    name: str
    covers: str
    how: str
    level: str


FIGURES = (
    Sigma("mean ± u", "the mean of n errors", "s/√n from the scatter s of the errors", "1 σ"),
    Sigma(
        "predicted, in the table of errors",
        "the RMS error of the same rows: model and measurement together",
        "from the covariance of the parameters and the σ of the rows",
        "1 σ; of points and poses 3-D",
    ),
)
"""Those of the table of errors at the top of a page."""

IDENTIFICATION = (
    Sigma(
        "assumed σ",
        "one parameter, before the data: how far such robots are from their nominal values",
        "robot file, default, or the covariance of the prior model",
        "1 σ",
    ),
    Sigma(
        "deviation ± σ",
        "one parameter, after the data",
        "covariance of the fit, from the rows and the assumed σ; scaled by the scatter that was found",
        "1 σ",
    ),
    Sigma(
        "σ of X, Y, Z, a zero, an offset",
        "one coordinate of a base, tool, sphere or socket; one length",
        "covariance of the fit",
        "1 σ for each coordinate",
    ),
    Sigma(
        "σ of A, B, C, of a tilt",
        "the rotation as a whole",
        "root of the sum of the variances about the axes",
        "1 σ, all axes together",
    ),
    Sigma(
        "1 σ of the TCP; 1 σ over the joints, in the verdict",
        "the position that the model predicts, as `cellctl predict` states it; without the scatter of a measurement",
        "root of the sum of the three variances of X, Y, Z: covariance of the parameters, open variance of the "
        "residual models, scatter of errors too fast for the model, doubt outside the measured joints",
        "1 σ, 3-D. Not 95 %: if alike in all directions, 95 % of the errors are within 1.61 times this value",
    ),
    Sigma(
        "σ after, in the table of postures",
        "the same, of points among themselves, with that posture and those above it measured",
        "covariance that the fit would have then; the rest as above",
        "1 σ, 3-D",
    ),
    Sigma(
        "predicted σ of a residual",
        "one number of a row: measurement and model for held-out rows, measurement less model for rows of the fit",
        "σ² + JCJᵀ for held-out rows, σ² − JCJᵀ for rows of the fit",
        "1 σ; ±1.96 σ is 95 % of one number",
    ),
    Sigma(
        "95 % region of a held-out row",
        "all numbers of the row together",
        "interval or ellipsoid of the same covariance, with the tails that folds of the fit's rows show",
        "95 %",
    ),
    Sigma(
        "mean of neighbouring rows ± 2 standard errors",
        "the line in the pictures of residuals",
        "from the scatter of the rows in a bin",
        "2 σ, about 95 %",
    ),
    Sigma(
        "gain ± standard error; drift ± standard error",
        "a difference between two models; a slope over the rows",
        "from the scatter of the paired errors; of the residuals about the line",
        "1 σ",
    ),
)
"""Those of the sections about an identification."""
