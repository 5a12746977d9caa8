"""Compensated targets as CSV, for controllers that take no table. See docs/reference/compensation.md."""

from __future__ import annotations

from cellctl.formats.dataset import text_of
from cellctl.formats.model import ModelFile
from cellctl.formats.table import Row
from cellctl.formats.table_making import nominal_chain

_POSE = ("X", "Y", "Z", "A", "B", "C")


def compensated_csv(model: ModelFile, rows: list[Row]) -> str:
    """CSV with a line for each row: target, compensated joints, pseudo-target, nominal joints, predicted errors, σ."""
    return text_of(compensated_records(model, rows))


def compensated_records(model: ModelFile, rows: list[Row]) -> list[dict[str, float | None]]:
    """The lines of the CSV, by column."""
    pseudo = _pseudo_targets(model, rows)
    names = columns(model.robot.n)
    return [dict(zip(names, _cells(row, sent), strict=True)) for row, sent in zip(rows, pseudo, strict=True)]


def columns(n: int) -> list[str]:
    """The columns for a robot of `n` joints."""
    axes = range(1, n + 1)
    joints, pseudo = [f"A{axis}" for axis in axes], [f"pseudo_{name}" for name in _POSE]
    nominal = [f"nominal_A{axis}" for axis in axes]
    return [*_POSE, *joints, *pseudo, *nominal, "predicted_before_mm", "predicted_after_mm", "sigma_mm"]


def _cells(row: Row, pseudo: list[float]) -> list[float | None]:
    figures = [row.predicted_before_mm, row.predicted_after_mm, row.sigma_mm]
    return [*row.target, *row.compensated, *pseudo, *row.nominal, *figures]


def _pseudo_targets(model: ModelFile, rows: list[Row]) -> list[list[float]]:
    """Where a controller with nominal kinematics believes its TCP at the compensated joints: X, Y, Z, A, B, C."""
    import numpy as np

    from cellctl.kinematics import abc_from_rotation

    readings = np.array([row.compensated for row in rows])
    poses = nominal_chain(model).forward(model.robot.joint_map().model(readings))
    found = np.hstack([poses[:, :3, 3], abc_from_rotation(poses[:, :3, :3])]).round(9) + 0.0  # no minus zero
    return [list(map(float, row)) for row in found]
