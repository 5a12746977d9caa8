"""What a fit came to, as the JSON that `cellctl fit` and a campaign give out, and as one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cellctl.formats.measurements import Measurements

if TYPE_CHECKING:
    from cellctl.calibration import FitResult

_NOUNS = {"position": "positions", "pose": "poses", "sphere": "touches", "socket": "sockets"}


def fit_report(measured: Measurements, result: FitResult) -> dict[str, Any]:
    """The result's figures with outliers and rejected rows by line; the time it took is left to the caller."""
    return {
        **result.summary(),
        "measure": measured.measure,
        "outliers": [
            {"line": measured.lines[row], "reason": _far_out(measured, result, row)}
            for row in result.identification.outliers
        ],
        "rejected": [{"line": row.line, "reason": row.reason} for row in measured.rejected],
        "sentence": sentence(measured, result),
    }


def sentence(measured: Measurements, result: FitResult) -> str:
    """The verdict in one sentence."""
    from cellctl.calibration import verdict_sentence

    kind = _NOUNS[measured.measure]
    if not result.n_test:
        return f"Not proved: no {kind} were held out ({result.fit.mean:.3f} mm mean on those of the fit)."
    return verdict_sentence(result.verdict, result.nominal, result.test, result.n_test, kind)


def _far_out(measured: Measurements, result: FitResult, row: int) -> str:
    error = measured.task.rows.pick([row]).errors(result.identification.identified.state)[0]
    return f"{error:.3f} mm off, where the others are {result.fit.rms:.3f} mm off (RMS): left out of the fit"
