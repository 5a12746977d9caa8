"""The sections about residuals: pictures, and what they show in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.kinematics import Floats
from cellctl.report.distributions import before_and_after
from cellctl.report.fit.by_joint import explained, joint_pictures
from cellctl.report.fit.by_order import drifts, order_picture
from cellctl.report.fit.by_place import EACH, place_picture
from cellctl.report.fit.residuals import Residuals
from cellctl.report.fit.scaled import coverage, scaled_picture
from cellctl.report.fit.story import FitStory
from cellctl.report.maps import sphere_maps
from cellctl.report.numbers import fixed, percent, with_sigma
from cellctl.report.touches import TouchErrors

Section = dict[str, Any]

SPHERES = 12
"""More spheres than this are not drawn one by one, but as places."""

_NAMED = 3


def distribution(story: FitStory, rows: Residuals) -> Section:
    """Errors before and after: of the held-out rows, or, where there are none, of the fit's."""
    result = story.result
    sizes = [size[rows.fitted] for size in rows.sizes]
    nominal = result.nominal_errors if result.prior_errors is None else result.prior_errors
    before, after = (nominal, result.test_errors) if result.n_test else sizes
    what = "error of held-out rows" if result.n_test else "error of the fit's rows"
    return {"picture": before_and_after("errors", before, after, what), "count": len(before)}


def by_joint(story: FitStory, rows: Residuals) -> Section:
    """Against each joint, and which joints still explain something."""
    readings = story.readings[rows.index]
    found = explained(rows, readings)
    words = [
        f"{story.joints[joint]} ({fixed(size)} mm RMS, {percent(share)} of the variance along its way)"
        for joint, share, size in found[:_NAMED]
    ]
    pictures = joint_pictures(rows, readings, story.joints)
    return {"pictures": pictures, "explained": words, "wild": int(rows.outlying.sum())}


def by_place(story: FitStory, rows: Residuals) -> Section:
    """Where in space: maps of spheres for distances, views of the volume for points."""
    on_spheres = rows.distances & (rows.point >= 0) & ~np.isin(rows.point, list(story.task.planes))
    touches = rows.pick(on_spheres)
    mapped = bool(len(touches)) and len(np.unique(touches.point)) <= SPHERES
    others = rows.pick(~on_spheres) if mapped else rows
    one_frame = all(name != "base" for session in story.task.sessions[1:] for name in session.own)
    counted = int((~others.outlying).sum())
    return {
        "maps": sphere_maps(_touch_errors(story, touches)) if mapped else "",
        "views": place_picture(others, *_placed(others, story, one_frame)) if counted else "",
        "cells": counted > EACH,
        "frame": "the measuring frame" if one_frame else "the robot's base frame, as sessions have frames of their own",
    }


def _placed(rows: Residuals, story: FitStory, one_frame: bool) -> tuple[Floats, Floats]:
    """Places and errors (N, 3), mm, in the measuring frame, or turned into the robot's base."""
    if one_frame:
        return rows.tips, rows.after
    turns = np.array([model.chain.base_now[:3, :3] for model in story.found.state.models])
    return rows.at_base, np.einsum("nji,nj->ni", turns[rows.session], rows.after)


def _touch_errors(story: FitStory, rows: Residuals) -> TouchErrors:
    """Distances as the maps of spheres want them, those left out of the fit not among them."""
    rows = rows.pick(~rows.outlying)
    return TouchErrors(
        lines=tuple(story.lines[index] for index in rows.index),
        numbers=tuple(str(index) for index in rows.index),
        readings=story.readings[rows.index],
        spheres=tuple(story.task.points[index] for index in rows.point),
        held_out=rows.held_out,
        normals=rows.normals,
        before=rows.signed[0],
        after=rows.signed[1],
    )


def by_order(story: FitStory, rows: Residuals) -> Section:
    """Over the data set from first to last line, and what drifts."""
    lines = np.array(story.lines, float)
    order = lines[rows.index] if len(np.unique(lines)) == len(lines) else rows.index.astype(float)
    words = [f"{label}: {with_sigma(change, error)} mm" for label, change, error in drifts(rows, order)]
    return {"picture": order_picture(rows, order, story.sessions), "drifts": words}


def as_foreseen(rows: Residuals) -> Section:
    """Whether residuals are as large as their σ."""
    of_fit, of_held_out = coverage(rows)
    return {
        "picture": scaled_picture(rows),
        "fit": percent(of_fit) if of_fit is not None else "",
        "held_out": percent(of_held_out) if of_held_out is not None else "",
    }


def left_out(story: FitStory) -> list[Section]:
    """Rows that were not used, or held out and wild, by line with the reason."""
    kinds = (("outliers", "left out"), ("rejected", "not usable"), ("test_outliers", "held out, counted"))
    return [
        {"line": row["line"], "kind": words, "reason": row["reason"]}
        for name, words in kinds
        for row in story.said.get(name, [])
    ]
