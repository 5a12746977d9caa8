"""The sections about what was measured: held-out touches, stand-off, maps, stops, reference touches, the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cellctl.calibration import ErrorFigures
from cellctl.journal import PushedTable
from cellctl.kinematics import Bools, Floats
from cellctl.report.distributions import before_and_after, one_by_one
from cellctl.report.maps import against_joints, sphere_maps
from cellctl.report.numbers import fixed, percent, plain, significant
from cellctl.report.run import Run
from cellctl.report.series import over_travel, reference_touches
from cellctl.report.standoff import StandOff
from cellctl.report.touches import TouchErrors

Section = dict[str, Any]

_AGREES_MM = 5e-4
"""Figures computed anew may differ from the journal's by this before the page says so."""


def held_out_section(run: Run, errors: TouchErrors | None) -> Section | None:
    """Before and after on touches that the fit never saw, computed anew and compared with the journal's figures."""
    if errors is None or not errors.held_out.any():
        return None
    figures = run.figures
    return {
        "picture": before_and_after(
            "heldout", errors.before[errors.held_out], errors.after[errors.held_out], "distance to the surface"
        ),
        "predicted": fixed(figures.get("predicted_test_rms")),
        "found": fixed(figures.get("test", {}).get("rms")),
        "coverage": percent(figures.get("coverage_95")),
        "count": int(errors.held_out.sum()),
        "outside": _outside(run, errors),
        "off": _off(figures, errors),
    }


def _outside(run: Run, errors: TouchErrors) -> tuple[int, str]:
    """How many held-out touches lie outside the joint region of the fit, and the greatest error among them, mm."""
    assert run.model is not None
    outside = errors.held_out & ~run.model.inside(errors.readings)
    return int(outside.sum()), fixed(float(np.abs(errors.after[outside]).max(initial=0.0)))


def _off(figures: Mapping[str, Any], errors: TouchErrors) -> str:
    """By how much the figures computed anew differ from the journal's, mm; empty where they agree."""
    pairs = zip(("nominal", "test"), errors.figures(), strict=True)
    differences = [abs(figures.get(name, {}).get("mean", anew.mean) - anew.mean) for name, anew in pairs]
    return significant(max(differences)) if max(differences) > _AGREES_MM else ""


def standoff_section(run: Run) -> Section | None:
    """The proof on the sphere that the fit never saw."""
    rows = run.recorded("standoff")
    before, after = StandOff.of(rows, "before"), StandOff.of(rows, "after")
    if not before.errors.size and not after.errors.size:
        return None
    each = one_by_one("targets", after.numbers, after.errors, _bars(after), "error") if after.errors.size else ""
    return {
        "picture": before_and_after("standoff", before.errors, after.errors, "stand-off error"),
        "each": each,
        "counts": (len(before.errors), len(after.errors)),
        "predicted": significant(after.predicted_sigma),
        "found": significant(after.found_sigma),
        "foreseen": significant(before.found_sigma) if before.expected.any() else "",
        "ratio": significant(after.found_sigma / after.predicted_sigma),
        "within": percent(_within_two_sigma(after)),
        "located": len(run.recorded("locate")),
    }


def _bars(after: StandOff) -> Any:
    return np.where(np.isfinite(after.sigma), after.sigma, 0.0)


def _within_two_sigma(after: StandOff) -> float | None:
    known = np.isfinite(after.sigma)
    return float(np.mean(np.abs(after.unforeseen[known]) <= 2.0 * after.sigma[known])) if known.any() else None


def touches_section(run: Run, errors: TouchErrors | None) -> Section | None:
    """Where the touches are and how far off each is; without those that the fit left out, which would set the scale."""
    if errors is None:
        return None
    outliers = {row["line"] for row in run.figures.get("outliers", [])}
    errors = errors.pick([place for place, line in enumerate(errors.lines) if line not in outliers])
    if not errors.lines:
        return None
    spheres = [_on_sphere(errors, name) for name in sorted(set(errors.spheres))]
    return {
        "maps": sphere_maps(errors),
        "joints": against_joints(errors),
        "spheres": spheres,
        "left_out": len(outliers),
    }


def _on_sphere(errors: TouchErrors, name: str) -> Section:
    """Counts and figures of one sphere, the fit's touches and the held-out ones together."""
    mine = np.array([sphere == name for sphere in errors.spheres])
    before, after = (ErrorFigures.of(np.abs(values[mine])) for values in (errors.before, errors.after))
    held_out = int((mine & errors.held_out).sum())
    texts = [fixed(value) for of in (before, after) for value in (of.mean, of.rms, of.max)]
    return {"name": name, "fit": int(mine.sum()) - held_out, "held_out": held_out, "figures": texts}


def stops_section(run: Run) -> Section | None:
    """How the searches stopped."""
    rows = run.recorded("touch")
    if not rows:
        return None
    stops = run.verdict.get("stops") or {}
    return {
        "picture": over_travel(*_over_travel(run, rows)) if run.model else "",
        "count": len(rows),
        "mean": fixed(stops["overtravel_mean_mm"]) if "overtravel_mean_mm" in stops else "",
        "max": fixed(stops.get("overtravel_max_mm")),
        "cycles": max((row.get("stop_cycles", 0) for row in rows), default=0),
        "faulty": {name: sum(int(row.get(name, 0)) for row in rows) for name in ("late", "lost", "skipped")},
        "repeated": sum(int(row.get("attempt", 1)) > 1 for row in rows),
    }


def _over_travel(run: Run, rows: Sequence[Mapping[str, Any]]) -> tuple[Floats, Bools]:
    """The tip's way from contact to rest, mm (N,), and whether telegrams went wrong in that search (N,)."""
    assert run.model is not None
    joints, robot = run.model.robot.joint_map(), run.model.robot_model()
    contact, rest = (robot.tcp(joints.model(np.array([row[name] for row in rows]))) for name in ("joints", "resting"))
    faulty = np.array([any(row.get(name, 0) for name in ("late", "lost", "skipped")) for row in rows])
    return np.linalg.norm(rest - contact, axis=1), faulty


def drift_section(run: Run) -> Section | None:
    """The reference touches, and what was made of them."""
    rows = run.recorded("reference")
    if not rows:
        return None
    drift = run.verdict.get("drift")
    return {
        "picture": reference_touches(rows, drift if isinstance(drift, Mapping) else {}),
        "count": len(rows),
        "words": _pairs(drift) if isinstance(drift, Mapping) else [],
    }


def table_section(run: Run) -> Section | None:
    """The compensation table: what the journal says became of it, and what the file holds."""
    pushed = PushedTable.of(run.state)
    told: dict[str, Any] = {**pushed.row.data(), "now": pushed.state} if pushed else {}
    if not told and run.table is None:
        return None
    content = run.table or {}
    rows = [row for row in content.get("rows", []) if isinstance(row, Mapping)]
    told.setdefault("id", content.get("id"))
    told.setdefault("rows", len(rows))
    return {"told": _pairs(told), "rows": len(rows), "figures": _predicted(rows), "agrees": _same_id(told, content)}


def _same_id(told: Mapping[str, Any], content: Mapping[str, Any]) -> bool:
    return not content or told.get("id") == content.get("id")


def _predicted(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Name, mean and greatest of each column of predictions that every row has."""
    names = {
        "predicted_before_mm": "predicted error before, mm",
        "predicted_after_mm": "predicted error after, mm",
        "sigma_mm": "predicted 1 σ, mm",
    }
    columns = {words: [row.get(name) for row in rows] for name, words in names.items()}
    full = {words: [float(v) for v in values if isinstance(v, int | float)] for words, values in columns.items()}
    return [
        (words, _small(sum(values) / len(values)), _small(max(values)))
        for words, values in full.items()
        if values and len(values) == len(rows)
    ]


def _small(value: float) -> str:
    return significant(value) if value >= 1e-4 else "< 0.0001"


def _pairs(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [(_worded(name), plain(value)) for name, value in values.items()]


def _worded(name: str) -> str:
    """`max_correction_deg` → `max correction, °`."""
    words, _, unit = name.rpartition("_")
    known = {"mm": "mm", "deg": "°"}.get(unit) if words else None
    return f"{words.replace('_', ' ')}, {known}" if known else name.replace("_", " ")
