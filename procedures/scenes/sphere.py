"""Touches of spheres, stand-offs and poses at a fixed point: where they are, and their residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cellctl.calibration import sphere_centre
from cellctl.console.scene import ROBOTS, Points, Role, SceneRun, SceneSource
from cellctl.kinematics import Floats
from cellctl.records import Row
from procedures.steps.sphere.rows import LocateRow, ProofRow, ReferenceRow, StandOffRow, TouchRow
from procedures.steps.tool.rows import ToolErrorsRow, ToolPoseRow, ToolTouchRow

TOOLS = ("taught tool", "found tool")


def _tool_errors(run: SceneRun, n: int) -> tuple[Floats, Floats]:
    """Errors of the `n` contacts, in the order of measurement, with either tool (N,), mm; NaN: not found yet."""
    rows, _ = run.rows(ToolErrorsRow)
    if not rows or len(rows[-1]["taught"]) != n:
        return np.full(n, np.nan), np.full(n, np.nan)
    return np.abs(rows[-1]["taught"]), np.abs(rows[-1]["found"])


def tool_points(run: SceneRun) -> list[Points]:
    """Poses with the tip at the fixed point; touches are those of the spheres."""
    rows, seq = run.rows(ToolPoseRow)
    if not rows:
        return []
    before, after = _tool_errors(run, len(rows))
    at, label = run.setting.tcp([row["joints"] for row in rows]), [row["number"] for row in rows]
    group = Points.of("pose", Role.HELD_OUT, label, at, seq=seq, before=before, after=after, compared=TOOLS)
    return [group]


TOOL_SOURCE = SceneSource(points=tool_points)


_LEAST = 5
"""Touches of a sphere from which its centre is fitted for a preliminary residual: 4 have none."""

_MOST = 200
"""More touches than these do not change a centre that is drawn; every so many of them are used."""

_ROLES = {"fit": Role.FIT, "test": Role.HELD_OUT, "locate": Role.CHECK, "reference": Role.CHECK}

Rows = Sequence[Mapping[str, Any]]


def points(run: SceneRun) -> list[Points]:
    """Touches of every kind, and stand-offs; those of the plans that are not measured yet come last."""
    groups: list[Points] = []
    done: set[int] = set()
    groups += _touches(run, "touch", TouchRow, done)
    groups += _touches(run, "tool touch", ToolTouchRow, done)
    groups += _touches(run, "locating touch", LocateRow, done)
    groups += _touches(run, "reference touch", ReferenceRow, done)
    groups += _coming_touches(run, done)
    return [*groups, *_stand_offs(run)]


def found(run: SceneRun) -> Mapping[str, Floats]:
    """Centres of spheres, from the touches so far by the nominal robot; of the proof sphere as it was located."""
    rows, _ = run.rows(TouchRow)
    places = {name: centre for name, _, centre, _ in _centres(run, rows)}
    proofs, _ = run.rows(ProofRow)
    return places | {row["sphere"]: np.array(row["nominal_centre"]) for row in proofs}


def _touches(run: SceneRun, name: str, kind: type[Row], done: set[int]) -> Iterator[Points]:
    rows, seq = run.rows(kind)
    if not rows:
        return
    done |= {row["number"] for row in rows}
    readings = [row["joints"] for row in rows]
    at = run.setting.tcp(readings)
    tool = kind is ToolTouchRow
    before, after = _tool_errors(run, len(rows)) if tool else run.residuals(readings)
    if np.isnan(before).all() and kind in (TouchRow, ToolTouchRow):
        before = _preliminary(run, rows, at)
    label, pair = [row["number"] for row in rows], TOOLS if tool else ROBOTS
    every = Points.of(name, Role.FIT, label, at, seq=seq, before=before, after=after, compared=pair)
    yield from every.parts(_masks([_ROLES[row["set"]] for row in rows]))


def _masks(roles: Sequence[Role]) -> dict[Role, Any]:
    return {role: np.array([each is role for each in roles], bool) for role in Role}


def _preliminary(run: SceneRun, rows: Rows, at: Floats) -> Floats:
    """Distance of each touch from the sphere through its sphere's touches (N,), mm; NaN: too few touches."""
    result = np.full(len(rows), np.nan)
    for _, mine, centre, reach in _centres(run, rows):
        result[mine] = np.abs(np.linalg.norm(at[mine] - centre, axis=1) - reach)
    return result


def _centres(run: SceneRun, rows: Rows) -> Iterator[tuple[str, list[int], Floats, float]]:
    """Spheres with enough touches: name, which of the rows touch it, the centre (3,) through them by the nominal
    robot, mm, and the TCP's distance from it at a touch.
    """
    artefact = run.setting.artefact
    for sphere in artefact.spheres if artefact else ():
        mine = [index for index, row in enumerate(rows) if row["sphere"] == sphere.id]
        if artefact and len(mine) >= _LEAST:
            reach = sphere.diameter / 2.0 + artefact.tip_radius
            used = mine[:: max(1, len(mine) // _MOST)]
            yield (
                sphere.id,
                mine,
                sphere_centre(run.setting.tcp([rows[index]["joints"] for index in used]), reach),
                reach,
            )


def _coming_touches(run: SceneRun, done: set[int]) -> Iterator[Points]:
    plans = {plan["number"]: plan for name in ("touches", "references") for plan in run.planned(name) if "end" in plan}
    coming = [plan for number, plan in sorted(plans.items()) if number not in done]
    for role in Role:
        mine = [plan for plan in coming if _ROLES.get(plan.get("set", "")) is role]
        if mine:
            at = _on_surface(run, mine, lambda plan: plan["end"])
            yield Points.of("planned touch", role, [plan["number"] for plan in mine], at)


def _on_surface(
    run: SceneRun, plans: Sequence[Mapping[str, Any]], readings: Callable[[Mapping[str, Any]], Sequence[float]]
) -> Floats:
    """Where each plan's line meets its sphere (N, 3): a search ends beyond the surface."""
    ends, artefact = run.setting.tcp([readings(plan) for plan in plans]), run.setting.artefact
    for index, plan in enumerate(plans):
        sphere = artefact.sphere(plan["sphere"]) if artefact else None
        if artefact and sphere:
            away = ends[index] - sphere.centre
            reach = sphere.diameter / 2.0 + artefact.tip_radius
            ends[index] = sphere.centre + away * (reach / max(float(np.linalg.norm(away)), 1e-9))
    return ends


def _stand_offs(run: SceneRun) -> Iterator[Points]:
    rows, seq = run.rows(StandOffRow)
    done = {(row["number"], row["run"]) for row in rows}
    for when in ("before", "after"):
        mine = [(row, at) for row, at in zip(rows, seq.tolist(), strict=True) if row["run"] == when]
        if mine:
            yield _measured(run, when, [row for row, _ in mine], [at for _, at in mine])
    coming = [plan for plan in run.planned("standoffs") if (plan["number"], plan["run"]) not in done]
    if coming:
        label = [f"{plan['number']} {plan['run']}" for plan in coming]
        yield Points.of("planned stand-off", Role.TARGET, label, _on_surface(run, coming, lambda plan: plan["end"]))


def _measured(run: SceneRun, when: str, rows: Rows, seq: Sequence[float]) -> Points:
    error = np.abs([row["error_mm"] for row in rows])
    label = [f"{row['number']} {when}" for row in rows]
    at = run.setting.tcp([row["at_contact"] for row in rows])
    if when == "before":
        return Points.of("stand-off", Role.TARGET, label, at, seq=seq, before=error)
    return Points.of("stand-off", Role.TARGET, label, at, seq=seq, after=error, sigma=[row["sigma_mm"] for row in rows])


SPHERE_SOURCE = SceneSource(points=points, found=found)
