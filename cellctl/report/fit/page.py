"""The page of a fit and its sections, from the rows that a run stores of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cellctl.files import write_atomically
from cellctl.kinematics import Floats
from cellctl.records import IdentificationRow, ResidualsRow
from cellctl.report._page import template
from cellctl.report.budget import FIGURES, IDENTIFICATION
from cellctl.report.drawing import before_and_after
from cellctl.report.figures import fixed, percent, significant, with_sigma
from cellctl.report.fit import _pictures as pictures
from cellctl.report.fit._by_place import EACH, SphereErrors, place_picture, sphere_maps
from cellctl.report.fit._pictures import (
    axis_label,
    coverage,
    drifts,
    explained,
    joint_pictures,
    order_picture,
    scaled_picture,
)
from cellctl.report.fit._rows import identification_rows
from cellctl.report.fit._story import FitStory
from cellctl.report.fit.residuals import Residuals
from cellctl.version import __version__

Section = dict[str, Any]

SPHERES = 12
"""More spheres than this are drawn as places, not one by one."""

_NAMED = 3
_LONG = 90
"""Number of letters from which a combination is folded."""


def identification_sections(residuals: ResidualsRow, found: IdentificationRow) -> Section:
    """The data for the template `identification.html`."""
    rows = Residuals.of_row(residuals)
    return {
        "head": found.head,
        "distribution": distribution(found),
        "joints": by_joint(rows, found),
        "places": by_place(rows, found),
        "order": by_order(rows, found),
        "scaled": as_predicted(rows),
        "parameters": found.parameters,
        "correlation": correlation(found),
        "unobservable": unobservable(found),
        "region": region(rows, found),
        "hints": found.hints,
        "advice": found.advice and {**found.advice, "joints": [axis_label(name) for name in found.advice["joints"]]},
        "joint_names": found.joints,
        "left_out": found.left_out,
    }


def distribution(found: IdentificationRow) -> Section:
    """Errors before and after."""
    what = "error of held-out rows" if found.held_out else "error of the fit's rows"
    picture = before_and_after("errors", np.array(found.before, float), np.array(found.after, float), what)
    return {"picture": picture, "count": len(found.before)}


def by_joint(rows: Residuals, found: IdentificationRow) -> Section:
    """Residuals against each joint, and the joints with a remaining pattern."""
    words = [
        f"{found.joints[joint]} ({fixed(size)} mm RMS, {percent(share)} of the variance along its way)"
        for joint, share, size in explained(rows)[:_NAMED]
    ]
    return {"pictures": joint_pictures(rows, found.joints), "explained": words, "outliers": int(rows.outlier.sum())}


def by_place(rows: Residuals, found: IdentificationRow) -> Section:
    """Residuals by place: maps of spheres for distances, views of the volume for points."""
    touches = rows.pick(rows.on_sphere)
    mapped = bool(len(touches)) and len(np.unique(touches.point)) <= SPHERES
    others = rows.pick(~rows.on_sphere) if mapped else rows
    counted = int((~others.outlier).sum())
    return {
        "maps": sphere_maps(_on_spheres(touches)) if mapped else "",
        "views": place_picture(others, *_placed(others, found)) if counted else "",
        "cells": counted > EACH,
        "frame": "the measuring frame"
        if found.one_frame
        else "the robot's base frame, as sessions have frames of their own",
    }


def _placed(rows: Residuals, found: IdentificationRow) -> tuple[Floats, Floats]:
    """Places and errors (N, 3), mm, in the measuring frame, or turned into the robot's base."""
    if found.one_frame:
        return rows.tip, rows.after
    turns = np.array(found.base_turns, float)
    return rows.tip_base, np.einsum("nji,nj->ni", turns[rows.session], rows.after)


def _on_spheres(rows: Residuals) -> SphereErrors:
    """Touches for the maps of spheres, without those left out of the fit."""
    rows = rows.pick(~rows.outlier)
    return SphereErrors(rows.point.tolist(), rows.held_out, rows.normal, rows.signed_before, rows.signed_after)


def by_order(rows: Residuals, found: IdentificationRow) -> Section:
    """Residuals from the first to the last line of the data set, and drifts."""
    order = (rows.line if len(np.unique(rows.line)) == len(rows) else rows.row).astype(float)
    words = [f"{label}: {with_sigma(change, error)} mm" for label, change, error in drifts(rows, order)]
    return {"picture": order_picture(rows, order, found.sessions), "drifts": words}


def as_predicted(rows: Residuals) -> Section:
    """Whether residuals are as large as their predicted σ."""
    of_fit, of_held_out = coverage(rows)
    return {
        "picture": scaled_picture(rows),
        "fit": percent(of_fit) if of_fit is not None else "",
        "held_out": percent(of_held_out) if of_held_out is not None else "",
    }


def correlation(found: IdentificationRow) -> Section | None:
    """Picture and strongest pairs; None for fewer than two parameters."""
    labels, matrix = found.correlated, np.array(found.correlation, float)
    if len(labels) < 2:
        return None
    return {
        "picture": pictures.correlation_picture(labels, matrix),
        "strongest": pictures.strongest(labels, matrix),
        "strong": pictures.count_strong(matrix),
        "shown": min(len(labels), pictures.MOST),
        "all": len(labels),
        "limit": f"{pictures.STRONG:g}",
    }


def unobservable(found: IdentificationRow) -> list[tuple[Any, list[str], list[str]]]:
    """Unobservable combinations and the reasons: the short ones, the long ones."""
    split = [(each, each["phrases"]) for each in found.unobservable]
    return [
        (reason, [each for each in phrases if len(each) <= _LONG], [each for each in phrases if len(each) > _LONG])
        for reason, phrases in split
    ]


def region(rows: Residuals, found: IdentificationRow) -> Section | None:
    """σ of the TCP over the joints; None for a model that states none."""
    if not found.sigma_rms_mm:
        return None
    readings = rows.readings[rows.fitted]
    curves = [(np.array(at), np.array(sigma)) for at, sigma in found.along_joint]
    named = map(pictures.name_and_unit, found.joints)
    lows, highs = readings.min(axis=0).tolist(), readings.max(axis=0).tolist()
    ends = [
        (name, low, high, unit.replace("mm", " mm")) for (name, unit), low, high in zip(named, lows, highs, strict=True)
    ]
    return {
        "figures": {
            name: (significant(rms), significant(found.sigma_max_mm[name])) for name, rms in found.sigma_rms_mm.items()
        },
        "pictures": pictures.region_pictures(curves, readings, found.joints),
        "region": ends,
        "bound": found.distribution_free,
    }


def write_fit_page(path: Path, story: FitStory) -> None:
    """Write the report of a fit to `path`. Raises OSError."""
    write_atomically(path, fit_page(story))


def fit_page(story: FitStory) -> str:
    """The report of a fit as HTML: no script, nothing fetched, no date; the same fit gives the same bytes."""
    return template("fit.html").render(
        **identification_sections(*identification_rows(story)),
        conditions=story.conditions,
        sigmas=(*FIGURES, *IDENTIFICATION),
        version=__version__,
    )
