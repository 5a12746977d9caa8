"""The series of the charts: residual of each point in the order of measurement, and the predicted σ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.console.scene.content import read_points
from cellctl.console.scene.points import ROBOTS, Points, Role, SceneRun, installed_sources
from cellctl.console.scene.setting import Setting
from cellctl.files import InputError
from cellctl.journal import RunState
from cellctl.kinematics import Floats
from cellctl.records import IdentificationRow

NOMINAL, IDENTIFIED = ROBOTS

Pair = tuple[float, float]


@final
@dataclass(frozen=True, eq=False)
class Line:
    """One series of a chart. xy: place in the order of measurement, from 1, and value, mm. labels: of each point.

    robot: what the values are of: NOMINAL, IDENTIFIED, or another pair of a source; after: the second of the pair.
    held_out: no fit used these points: held-out ones, and targets.
    """

    name: str
    robot: str
    after: bool
    held_out: bool
    xy: tuple[Pair, ...]
    labels: tuple[str, ...]


@final
@dataclass(frozen=True, eq=False)
class Series:
    """What the two charts show, mm. measured: points so far.

    residuals: by robot and by use of the points. sigmas: predicted 1 σ of targets, in the order of measurement, and
    errors: the residual found at the same targets. levels: name and value of each σ over the joints of the fit.
    residual_note, sigma_note: what is not known yet or is preliminary; empty if nothing.
    """

    measured: int = 0
    residuals: tuple[Line, ...] = ()
    sigmas: tuple[Line, ...] = ()
    errors: tuple[Line, ...] = ()
    levels: tuple[tuple[str, float], ...] = ()
    residual_note: str = ""
    sigma_note: str = ""


def series_of(state: RunState, points: Sequence[Points] | None = None) -> Series:
    """The series of a run so far; points: those of its `SceneContent`, if that is at hand.

    What cannot be read is left out; `scene_of` states why.
    """
    if points is None:
        points = read_points(SceneRun(state, Setting.of(state.started)), installed_sources()[0], [])
    groups = [group for group in points if group.role is not Role.CHECK]
    order = _order(groups)
    levels = _levels(state)
    targets = [group for group in groups if np.isfinite(group.sigma).any()]
    residuals = tuple(_residual_lines(groups, order))
    sigmas = [_joined(targets, [each.sigma for each in targets], order, "predicted σ", IDENTIFIED, True)]
    errors = [_joined(targets, [each.after for each in targets], order, "found error", IDENTIFIED, True)]
    return Series(
        measured=len(order),
        residuals=residuals,
        sigmas=tuple(line for line in sigmas if line.xy),
        errors=tuple(line for line in errors if line.xy),
        levels=levels,
        residual_note=_residual_note(residuals, identified=bool(levels)),
        sigma_note=_sigma_note(levels, targets),
    )


def _order(groups: Sequence[Points]) -> dict[float, int]:
    """Event → place in the order of measurement, from 1."""
    events = np.concatenate([group.seq for group in groups]) if groups else np.zeros(0)
    return {seq: place for place, seq in enumerate(np.unique(events[events > 0]).tolist(), 1)}


def _residual_lines(groups: Sequence[Points], order: dict[float, int]) -> list[Line]:
    uses = ((Role.FIT, "points of the fit"), (Role.HELD_OUT, "held-out points"), (Role.TARGET, "targets"))
    lines = []
    for pair in dict.fromkeys(group.compared for group in groups):
        for after, robot in enumerate(pair):
            for role, use in uses:
                mine = [each for each in groups if each.role is role and each.compared == pair]
                columns = [each.after if after else each.before for each in mine]
                lines.append(_joined(mine, columns, order, f"{robot}, {use}", robot, bool(after)))
    return [line for line in lines if line.xy]


def _joined(
    groups: Sequence[Points], columns: Sequence[Floats], order: dict[float, int], name: str, robot: str, after: bool
) -> Line:
    """One line of the points of all `groups` whose values, one column for each group, are known."""
    found = sorted(
        ((float(order[float(group.seq[k])]), float(values[k])), f"{group.name} {group.label[k]}")
        for group, values in zip(groups, columns, strict=True)
        for k in np.flatnonzero(np.isfinite(values) & (group.seq > 0)).tolist()
    )
    held_out = any(group.role is not Role.FIT for group in groups)
    return Line(name, robot, after, held_out, tuple(pair for pair, _ in found), tuple(label for _, label in found))


def _levels(state: RunState) -> tuple[tuple[str, float], ...]:
    try:
        row = state.last(IdentificationRow)
    except InputError:
        return ()
    if row is None:
        return ()
    known = (
        ("RMS over the joints of the fit", row.sigma_rms_mm),
        ("greatest over the joints of the fit", row.sigma_max_mm),
    )
    return tuple((name, float(values["among"])) for name, values in known if "among" in values)


def _residual_note(residuals: Sequence[Line], *, identified: bool) -> str:
    if not residuals:
        return "No residual is known yet: it needs some measured points."
    if not identified and not any(line.after for line in residuals):
        return (
            "Preliminary: the nominal robot against centres or an instrument fitted to the points so far. "
            "An identification replaces them."
        )
    return ""


def _sigma_note(levels: Sequence[object], targets: Sequence[Points]) -> str:
    if not levels:
        return "σ is not known yet: the identification predicts it."
    return "" if targets else "σ of each target is not in the journal yet; the lines are σ over the joints of the fit."
