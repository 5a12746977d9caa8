"""Poses with an instrument: where the reflectors were measured, and their residuals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration import rigid_fit
from cellctl.console.scene import Points, Role, SceneRun, SceneSource
from cellctl.kinematics import Floats
from procedures.steps.iso9283.rows import IsoPoseRow, IsoRow
from procedures.steps.tracker.rows import (
    CompensatedRow,
    MonumentsRow,
    NestRow,
    PoseRow,
    ReturnRow,
    StationRow,
    TargetErrorsRow,
    TurnRow,
    VisitedRow,
)
from procedures.steps.tracker.station import FIRST_SESSION, Sessions

Rows = Sequence[Mapping[str, Any]]

_LEAST = 6
"""Poses from which the instrument is placed by them for a preliminary residual."""

_ROLES = {"fit": Role.FIT, "test": Role.HELD_OUT, "compensated": Role.TARGET, "cube": Role.TARGET}


def points(run: SceneRun) -> list[Points]:
    """Poses, compensated targets, turns and returns; those of the plans that are not measured yet come last."""
    groups = list(_poses(run))
    groups += _targets(run)
    kinds: tuple[tuple[str, type[VisitedRow]], ...] = (("turn", TurnRow), ("return", ReturnRow))
    for name, kind in kinds:
        groups += _group(run, name, Role.CHECK, *run.rows(kind))
    return [*groups, *_cube(run), *_coming(run)]


def found(run: SceneRun) -> Mapping[str, Floats]:
    """The instrument's frame in the robot's base frame, and the nests as they were measured last."""
    stations, _ = run.rows(StationRow)
    nests, _ = run.rows(NestRow)
    if not stations:
        return {}
    station = np.array(stations[-1]["matrix"])
    return {"station": station} | {row["nest"]: _in_base(station, [row["point"]["xyz"]])[0] for row in nests}


def _in_base(station: Floats, places: ArrayLike) -> Floats:
    return np.asarray(np.reshape(places, (-1, 3)) @ station[:3, :3].T + station[:3, 3])


def _at(run: SceneRun, rows: Rows) -> Floats:
    """Places of the reflectors (N, 3) by the nominal robot, base frame, mm."""
    by_name = {
        name: run.setting.reflector(name, [row["joints"] for row in rows])
        for name in {row["reflector"] for row in rows}
    }
    return np.array([by_name[row["reflector"]][index] for index, row in enumerate(rows)])


def _group(
    run: SceneRun,
    name: str,
    role: Role,
    rows: Rows,
    seq: Floats,
    *,
    before: ArrayLike = np.nan,
    after: ArrayLike = np.nan,
    sigma: ArrayLike = np.nan,
) -> Iterator[Points]:
    if rows:
        label, at = [row["number"] for row in rows], _at(run, rows)
        yield Points.of(name, role, label, at, seq=seq, before=before, after=after, sigma=sigma)


def _poses(run: SceneRun) -> Iterator[Points]:
    rows, seq = run.rows(PoseRow)
    before, after = run.residuals([row["joints"] for row in rows])
    if np.isnan(before).all() and len(rows) >= _LEAST:
        before = _preliminary(run, rows)
    for every in _group(run, "pose", Role.FIT, rows, seq, before=before, after=after):
        fit = np.array([row["set"] == "fit" for row in rows])
        yield from every.parts({Role.FIT: fit, Role.HELD_OUT: ~fit})


def _preliminary(run: SceneRun, rows: Rows) -> Floats:
    """Distance of each measured place from the nominal robot's (N,), mm, the instrument placed by these poses."""
    nominal, measured = _at(run, rows), np.array([row["point"]["xyz"] for row in rows])
    return np.asarray(np.linalg.norm(_in_base(rigid_fit(measured, nominal), measured) - nominal, axis=1))


def _targets(run: SceneRun) -> Iterator[Points]:
    """Targets by the table in force: measured less intended place."""
    rows, seq = run.rows(CompensatedRow)
    if not rows:
        return
    sessions = _sessions(run)
    places = [_in_first(sessions, row) for row in rows]
    error = [float(np.linalg.norm(at - np.array(row["target"]))) for at, row in zip(places, rows, strict=True)]
    known = {n: s for each in run.rows(TargetErrorsRow)[0] for n, s in zip(each["number"], each["sigma"], strict=True)}
    sigma = np.array([known.get(row["number"], np.nan) for row in rows])
    yield from _group(run, "compensated target", Role.TARGET, rows, seq, after=np.array(error), sigma=sigma)


def _sessions(run: SceneRun) -> Sessions:
    """As `Sessions.of`, from rows as the journal holds them."""
    visits = sorted(run.rows(MonumentsRow)[0], key=lambda row: int(row["visit"]))
    places = {row["session"]: np.array(row["matrix"]) for row in run.rows(StationRow)[0]}
    found = Sessions([row["session"] for row in visits], places)
    known = (found.session(row["visit"]) for row in run.rows(PoseRow)[0])
    return replace(found, first=next(filter(None, known), FIRST_SESSION))


def _in_first(sessions: Sessions, row: Mapping[str, Any]) -> Floats:
    """The measured place (3,), mm, in the instrument's frame of the first session; NaN without a session."""
    session = sessions.session(row["visit"])
    xyz = np.array([row["point"]["xyz"]])
    return np.full(3, np.nan) if session is None else sessions.to_first(session, xyz)[0]


def _cube(run: SceneRun) -> Iterator[Points]:
    """Visits to the points of the ISO cube; their distances from the commanded places once the test is evaluated."""
    rows, seq = run.rows(IsoPoseRow)
    tests = {row["when"]: row["deviations"] for row in run.rows(IsoRow)[0] if not row["figures"]["left_out"]}
    for when in ("before", "after"):
        chosen = [index for index, row in enumerate(rows) if row["when"] == when]
        mine = [rows[index] for index in chosen]
        error = [_deviation(tests.get(when, ()), row) for row in mine]
        unknown = [np.nan] * len(error)
        before, after = (error, unknown) if when == "before" else (unknown, error)
        yield from _group(run, f"cube {when}", Role.TARGET, mine, seq[chosen], before=before, after=after)


def _deviation(cycles: Sequence[Sequence[Sequence[float]]], row: Mapping[str, Any]) -> float:
    """Distance from the commanded place, mm; NaN: not known, or a visit of another kind than that of the cycles."""
    known = not row["side"] and row["cycle"] < len(cycles)
    return float(np.linalg.norm(cycles[row["cycle"]][row["place"]])) if known else float("nan")


def _coming(run: SceneRun) -> Iterator[Points]:
    kinds: tuple[type[VisitedRow], ...] = (PoseRow, CompensatedRow, TurnRow, IsoPoseRow)
    done = [(row["number"], tuple(row["commanded"])) for kind in kinds for row in run.rows(kind)[0]]
    plans = [plan for plan in run.planned("poses") if "reflector" in plan and "joints" in plan]
    coming = [plan for plan in plans if (plan["number"], tuple(plan["joints"])) not in set(done)]
    for role in Role:
        mine = [plan for plan in coming if _ROLES.get(plan["kind"], Role.CHECK) is role]
        if mine:
            at = [run.setting.reflector(plan["reflector"], [plan["joints"]])[0] for plan in mine]
            yield Points.of(f"planned {mine[0]['kind']} pose", role, [plan["number"] for plan in mine], at)


SOURCE = SceneSource(points=points, found=found)
