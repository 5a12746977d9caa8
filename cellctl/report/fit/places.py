"""Estimated places: base and tool if an instrument measured them, spheres, sockets, planes, zeros of lengths."""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.calibration import plane_estimates
from cellctl.kinematics import Floats, abc_from_rotation
from cellctl.report.fit.story import FitStory
from cellctl.report.fit.table import found_anew
from cellctl.report.numbers import fixed, significant

Section = dict[str, Any]

MANY = 24
"""More points than this are folded until the reader opens them."""


def points(story: FitStory) -> list[Section]:
    """Each sphere or socket with its σ; marks those without a row of the fit."""
    found = story.found
    sigma = np.sqrt(np.maximum(np.diag(found.covariance)[found.state.of_points], 0.0)).reshape(-1, 3)
    visits = _counts(story, "point", len(story.task.points))
    return [
        {
            "name": name,
            "visits": int(visits[index]),
            "xyz": [fixed(float(value), 3) for value in found.state.points[index]],
            "sigma": [significant(float(value)) if visits[index] else "" for value in sigma[index]],
        }
        for index, name in enumerate(story.task.points)
        if index not in story.task.planes
    ]


def planes(story: FitStory) -> list[Section]:
    """Each plane with its σ; marks those without a row of the fit."""
    visits = _counts(story, "point", len(story.task.points))
    return [
        {
            "name": story.task.points[plane.point],
            "visits": int(visits[plane.point]),
            "normal": [fixed(float(value), 5) for value in plane.normal],
            "offset": fixed(plane.offset_mm, 3),
            "sigma": significant(plane.sigma_mm),
            "tilt": significant(plane.tilt_sigma_deg),
        }
        for plane in plane_estimates(story.task, story.found)
    ]


def datums(story: FitStory) -> list[Section]:
    """The zero offset of each instrument of unknown zero, with its σ; none without a row of the fit."""
    found, rows = story.found, _counts(story, "zeros", len(story.task.datums))
    sigma = np.sqrt(np.maximum(np.diag(found.covariance)[found.state.datums_at :], 0.0))
    return [
        {"name": name, "rows": int(rows[at]), "mm": fixed(float(value), 3), "sigma": significant(float(sigma[at]))}
        for at, (name, value) in enumerate(zip(story.task.datums, found.state.datums, strict=True))
        if rows[at]
    ]


def _counts(story: FitStory, column: str, count: int) -> Any:
    """Number of rows of the fit for each number (`count`,) in a column of their blocks."""
    blocks = story.task.rows.pick(story.used).blocks
    numbers = np.concatenate([np.zeros(0, int), *(getattr(block, column, np.zeros(0, int)) for block in blocks)])
    return np.bincount(numbers[numbers >= 0].astype(int), minlength=count)


def placements(story: FitStory) -> list[Section]:
    """Base and tool of each session, if estimated: pose, σ of position and of rotation."""
    found, anew = story.found, found_anew(story) & story.found.unknowns.free
    parameters = story.found.state.model.parameters
    rows, shown = [], set()
    for number, model in enumerate(found.state.models):
        columns = found.state.columns[number]
        for frame, pose in (("base", model.chain.base_now), ("tool", model.chain.tool_now)):
            own = [column for column, each in zip(columns, parameters, strict=True) if each.group == frame]
            if anew[own].any() and tuple(own) not in shown:
                shown.add(tuple(own))
                session = story.sessions[number] if len(found.state.models) > 1 else ""
                rows.append(_placement(session, frame, pose, found.covariance[np.ix_(own, own)]))
    return rows


def _placement(session: str, frame: str, pose: Floats, covariance: Floats) -> Section:
    """Translations rotated from the frame's own axes, along which they are parameters, to the axes of its place."""
    turn = pose[:3, :3]
    place = np.sqrt(np.maximum(np.diag(turn @ covariance[:3, :3] @ turn.T), 0.0))
    turned = float(np.rad2deg(np.sqrt(max(np.trace(covariance[3:, 3:]), 0.0))))
    return {
        "session": session,
        "frame": frame,
        "xyz": [fixed(float(value), 3) for value in pose[:3, 3]],
        "sigma": [significant(float(value)) for value in place],
        "abc": [fixed(float(value), 3) for value in np.atleast_1d(abc_from_rotation(turn))],
        "turned": significant(turned) if turned else "",
    }
