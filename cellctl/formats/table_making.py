"""From an identified model and targets to a table, and postures of the model's measured region."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration import Postures
from cellctl.compensation import Compensated, MappedErrors, PredictedErrors, compensate, postures
from cellctl.files import sha256_of
from cellctl.formats.measurements import nominal_model
from cellctl.formats.model import REGION_MARGIN_DEG, ModelFile
from cellctl.formats.table import JOINT_DECIMALS, Row, TableFile, TableRegion, TableRobot, TableSource, table_rows
from cellctl.kinematics import Floats, SerialChain, abc_from_rotation

DRAWN = 300
"""Postures drawn in the measured region of a model that keeps too few of its own."""
LEAST = 30
SEED = 20_131


def measured_postures(model: ModelFile) -> Postures:
    """Its measured postures, or postures drawn over its joint region where it keeps few.

    The approach of each joint is drawn, and the payload between those of the fit; temperature and currents are unknown.
    """
    region, loads, rng = model.joint_region, model.load_region, np.random.default_rng(SEED)
    readings = np.array(region.postures or [])
    if len(readings) < LEAST:
        readings = rng.uniform(region.min, region.max, (DRAWN, model.robot.n))
    approach = rng.choice([-1.0, 1.0], readings.shape)
    payload = rng.uniform(loads.min, loads.max, len(readings)) if loads else None
    at = np.tile(loads.at, (len(readings), 1)) if loads and loads.at else None
    return Postures(model.robot.joint_map().model(readings), approach, payload=payload, payload_at=at)


def nominal_chain(model: ModelFile) -> SerialChain:
    """The nominal chain that `model` counts from: the robot file's links, with the fit's base and tool."""
    placed = nominal_model(model.robot).on(np.array(model.start["base"]), np.array(model.start["tool"]))
    return placed.chain


def compensated_targets(
    model: ModelFile,
    targets: Floats,
    postures: Floats,
    *,
    method: str = "pseudo-target",
    passes: int | None = None,
    errors: PredictedErrors | None = None,
    tolerance_mm: float = 1e-6,
) -> Compensated:
    """Compensate `targets` (N, 4, 4), mm, in the model's frame, from controller readings `postures` (N, n), deg.

    method, passes, tolerance_mm: as in `cellctl.compensation.compensate`. errors: predicted position errors (`errors`
    of an error map) in the frame of the model, in place of the identified robot; for `cyclic-search`. A target whose
    joints leave the limits of the robot file is not converged, with the joint as its reason.
    """
    joints = model.robot.joint_map()
    found = compensate(
        nominal_chain(model),
        errors or model.robot_model(),
        targets,
        joints.model(postures),
        method=method,
        passes=passes,
        tolerance_mm=tolerance_mm,
        region=measured_postures(model),
    )
    return _within_limits(found, joints.readings(found.compensated_q), model.robot.limits())


def _within_limits(found: Compensated, readings: Floats, limits: Floats) -> Compensated:
    """`found`, with a reason for each target that joints outside their limits (n, 2), deg, would reach."""
    beyond = (readings < limits[:, 0]) | (readings > limits[:, 1])
    reasons = list(found.reasons)
    for row in np.flatnonzero(found.converged & beyond.any(axis=1)).tolist():
        axis = int(np.argmax(beyond[row]))
        low, high = limits[axis]
        at = f"A{axis + 1} {readings[row, axis]:.3f}°"
        reasons[row] = f"compensated {at} is not within {low:g}…{high:g}°, outside the joint's limits"
    return replace(found, converged=np.array([not reason for reason in reasons], bool), reasons=tuple(reasons))


def usual_postures(model: ModelFile, targets: Floats) -> Floats:
    """Readings (N, n), deg, that reach `targets` (N, 4, 4) nominally, inside the model's region; NaN: none does."""
    joints, region = model.robot.joint_map(), valid_region(model)
    ends = np.sort(joints.model([region.min, region.max]), axis=0)
    return joints.readings(postures(nominal_chain(model), targets, ends[0], ends[1]))


def valid_region(model: ModelFile) -> TableRegion:
    """Readings inside the measured region of `model` and the joint limits, deg."""
    rows = zip(model.joint_region.min, model.joint_region.max, model.robot.joints, strict=True)
    ends = [
        (max(low - REGION_MARGIN_DEG, joint.min), min(high + REGION_MARGIN_DEG, joint.max)) for low, high, joint in rows
    ]
    return TableRegion(min=[low for low, _ in ends], max=[high for _, high in ends])


def sigma_among_rows(model: ModelFile, rows: list[Row]) -> float | None:
    """1 σ (3-D, RMS), mm, of the rows' TCPs relative to each other; None for fewer than four rows, and for rows whose
    errors another predictor than the model stated.

    The part of `sigma_mm` without common rigid motions: the relevant one once the frame has been tied to something in
    the cell (a sphere, a fixture).
    """
    if len(rows) < 4 or any(row.sigma_mm is None for row in rows):
        return None
    return mean_rms_max(model.sigma(np.array([row.compensated for row in rows]), kind="among"))["rms"]


def _target_sigma(model: ModelFile, readings: Floats, errors: PredictedErrors | None) -> Floats | None:
    """1 σ (N,), 3-D, mm, of the TCP predicted at controller readings (N, n), deg: the model's, in the frame of what was
    touched for a model from touches, as targets are built on its points; or that of `errors`. None where there is none.
    """
    if errors is None:
        sigma = model.sigma(readings, frame="points")
        return None if np.isnan(sigma).any() else sigma
    return errors.sigma(model.robot.joint_map().model(readings)) if isinstance(errors, MappedErrors) else None


def target_rows(
    model: ModelFile,
    targets: Floats,
    found: Compensated,
    errors: PredictedErrors | None = None,
    *,
    exact: bool = False,
) -> list[Row]:
    """Rows of a table for `targets` (N, 4, 4), mm, as `found` by `compensated_targets` (with the same `errors`).

    The predicted errors are those of the joints as rounded for the controller: 1e-6° is 2e-5 mm at 1 m. exact: in full
    precision, where 1e-6 mm are left.
    """
    joints, identified, nominal = model.robot.joint_map(), model.robot_model(), nominal_chain(model)

    def away(readings: Floats) -> Floats:
        q = joints.model(readings)
        tcp = nominal.forward(q)[:, :3, 3] + errors(q) if errors else identified.tcp(q)
        return np.asarray(np.linalg.norm(tcp - targets[:, :3, 3], axis=1))

    readings = (joints.readings(q) for q in (found.nominal_q, found.compensated_q))
    start, commanded = (each if exact else each.round(JOINT_DECIMALS) for each in readings)
    poses = np.hstack([targets[:, :3, 3], abc_from_rotation(targets[:, :3, :3])])
    before, after = away(start), away(commanded)
    return table_rows(poses, start, commanded, before, after, _target_sigma(model, commanded, errors), exact=exact)


def table_of(
    model: ModelFile,
    targets: Floats,
    found: Compensated,
    *,
    serial: str,
    simulated: bool,
    run: str | None,
    created: str,
    method: str = "pseudo-target",
    errors: PredictedErrors | None = None,
) -> TableFile:
    """The table that sends controller `serial` to `targets` (N, 4, 4), mm, as `found` by `compensated_targets` (with
    the same `errors`).

    Raises ValueError where a target was not reached: leave it out before.
    """
    if not found.converged.all():
        rows = "; ".join(f"row {row}: {reason}" for row, reason in enumerate(found.reasons, 1) if reason)
        raise ValueError(f"targets that are not reached: {rows}")
    return TableFile.of(
        target_rows(model, targets, found, errors),
        robot=TableRobot(serial=serial, name=model.robot.name),
        simulated=simulated,
        tool=model.robot.tool,
        source=TableSource(run=run, model_sha256=sha256_of(model.text()), method=method),
        joint_region=valid_region(model),
        created=created,
    )


def table_figures(table: TableFile) -> dict[str, Any]:
    """A table in figures: its id, and those of its rows."""
    return {"id": table.id, **row_figures(table.rows)}


def row_figures(rows: list[Row]) -> dict[str, Any]:
    """Count, largest correction (deg); distances predicted before and after, σ (mm; None where none is known)."""
    sigma = [row.sigma_mm for row in rows if row.sigma_mm is not None]
    return {
        "rows": len(rows),
        "max_correction_deg": max(row.correction_deg for row in rows),
        "predicted_before_mm": mean_rms_max([row.predicted_before_mm for row in rows]),
        "predicted_after_mm": mean_rms_max([row.predicted_after_mm for row in rows]),
        "sigma_mm": mean_rms_max(sigma) if len(sigma) == len(rows) else None,
    }


def mean_rms_max(values: ArrayLike) -> dict[str, float]:
    """Mean, RMS and maximum of values (N,), N ≥ 1."""
    array = np.asarray(values, float)
    return {"mean": float(array.mean()), "rms": float(np.sqrt(np.mean(array**2))), "max": float(array.max())}
