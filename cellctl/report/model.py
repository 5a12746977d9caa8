"""The section about the identified model: parameters, what the data saw, what they cannot see, what was left out."""

from __future__ import annotations

from typing import Any

from cellctl.report.numbers import fixed, percent, significant
from cellctl.report.parameters import ParameterRow, held, parameter_rows
from cellctl.report.run import Run
from cellctl.report.volume import AROUND_MM, VolumeSigma, volume_sigma
from cellctl.report.words import harmless, reasons

Section = dict[str, Any]


def model_section(run: Run) -> Section | None:
    """Everything about the model; None where there is none."""
    if run.model is None:
        return None
    figures, volume, rows = run.figures, volume_sigma(run.model), parameter_rows(run.model)
    return {
        "name": run.model.model,
        "n_fit": figures.get("n_fit", 0),
        "fit_rms": fixed(figures.get("fit", {}).get("rms")),
        "n_parameters": figures.get("n_parameters", 0),
        "rank": figures.get("rank", 0),
        "ended": figures.get("ended", ""),
        "scatter": max(figures.get("noise_growth", []), default=1.0),
        "rows": [(row, percent(1.0 - row.prior_share), _bar(row)) for row in rows],
        "any_wide": any(row.wide for row in rows),
        "held": held(run.model),
        "centres": [_centre(centre.id, centre.xyz, centre.sigma) for centre in run.model.centres],
        "unseen": reasons(figures),
        "harmless": harmless(figures),
        "volume": _volume(volume) if volume else None,
        "region": list(zip(run.model.joint_region.min, run.model.joint_region.max, strict=True)),
        "left_out": _left_out(run),
    }


def _volume(volume: VolumeSigma) -> Section:
    return {
        "points": volume.points,
        "around": f"{AROUND_MM:g}",
        "raw": (significant(volume.raw_rms), significant(volume.raw_max)),
        "relative": (significant(volume.relative_rms), significant(volume.relative_max)),
    }


def _bar(row: ParameterRow) -> str:
    return f"{100.0 * (1.0 - row.prior_share):.1f}"


def _centre(name: str, xyz: list[float], sigma: list[float]) -> Section:
    return {"id": name, "xyz": [fixed(value, 2) for value in xyz], "sigma": [significant(value) for value in sigma]}


def _left_out(run: Run) -> list[Section]:
    """Outliers and rejected rows: line of the data set, number of the touch, reason."""
    numbers = dict(zip(run.data.lines, run.data.texts("touch"), strict=True)) if run.data else {}
    found = [(kind, row) for kind in ("outliers", "rejected") for row in run.figures.get(kind, [])]
    return [
        {"kind": kind.rstrip("s"), "line": row["line"], "touch": numbers.get(row["line"], ""), "reason": row["reason"]}
        for kind, row in found
    ]
