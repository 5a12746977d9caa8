"""From an identified model and targets to a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cellctl.files import sha256_of
from cellctl.formats.measurements import nominal_model
from cellctl.formats.model import REGION_MARGIN_DEG, ModelFile
from cellctl.formats.table import JOINT_DECIMALS, Row, TableFile, TableRegion, TableRobot, TableSource, table_rows

if TYPE_CHECKING:
    from cellctl.compensation import Compensated
    from cellctl.kinematics import Floats, SerialChain


def nominal_chain(model: ModelFile) -> SerialChain:
    """The nominal chain that `model` counts from: the robot file's links, with the fit's base and tool."""
    import numpy as np

    placed = nominal_model(model.robot).on(np.array(model.start["base"]), np.array(model.start["tool"]))
    return placed.chain


def compensated_targets(
    model: ModelFile, targets: Floats, postures: Floats, *, method: str = "pseudo-target"
) -> Compensated:
    """Compensate `targets` (N, 4, 4), mm, in the model's frame, from controller readings `postures` (N, n), deg."""
    from cellctl.compensation import compensate

    q = model.robot.joint_map().model(postures)
    return compensate(nominal_chain(model), model.robot_model(), targets, q, method=method)


def usual_postures(model: ModelFile, targets: Floats) -> Floats:
    """Readings (N, n), deg, that reach `targets` (N, 4, 4) nominally, inside the model's region; NaN: none does."""
    import numpy as np

    from cellctl.compensation import postures

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


def target_sigma(model: ModelFile, readings: Floats) -> Floats:
    """1 σ (N,), 3-D, mm, of the predicted TCP at controller readings (N, n), deg, in the model's frame.

    For a model from touches that is the frame of its sphere centres: see `cellctl.compensation.gauge_fixed`.
    """
    import numpy as np

    from cellctl.calibration import predict
    from cellctl.compensation import gauge_fixed

    covariance = np.array(model.covariance)
    if model.frame_of_points:
        covariance = gauge_fixed(covariance, [parameter.name for parameter in model.parameters])
    return predict(model.robot_model(), covariance, model.robot.joint_map().model(readings)).sigma_mm


def sigma_among_rows(model: ModelFile, table: TableFile) -> float | None:
    """1 σ (3-D, RMS), mm, of the rows' TCPs relative to each other; None for fewer than four rows.

    The part of `sigma_mm` without common rigid motions: the relevant one once the frame has been tied to something in
    the cell (a sphere, a fixture).
    """
    import numpy as np

    from cellctl.calibration import sigma_among

    if len(table.rows) < 4:
        return None
    q = model.robot.joint_map().model([row.compensated for row in table.rows])
    return sigma_among(model.robot_model(), np.array(model.covariance), q)


def target_rows(model: ModelFile, targets: Floats, found: Compensated) -> list[Row]:
    """Rows of a table for `targets` (N, 4, 4), mm, as `found` by `compensated_targets`.

    The predicted errors are those of the joints as rounded for the controller.
    """
    import numpy as np

    from cellctl.kinematics import abc_from_rotation

    joints, identified = model.robot.joint_map(), model.robot_model()
    nominal, commanded = (joints.readings(q).round(JOINT_DECIMALS) for q in (found.nominal_q, found.compensated_q))
    places = targets[:, :3, 3]
    before, after = (np.linalg.norm(identified.tcp(joints.model(at)) - places, axis=1) for at in (nominal, commanded))
    poses = np.hstack([places, abc_from_rotation(targets[:, :3, :3])])
    return table_rows(poses, nominal, commanded, before, after, target_sigma(model, commanded))


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
) -> TableFile:
    """The table that sends controller `serial` to `targets` (N, 4, 4), mm, as `found` by `compensated_targets`.

    Raises ValueError where a target was not reached: leave it out before.
    """
    import numpy as np

    if not found.converged.all():
        rows = ", ".join(str(row + 1) for row in np.flatnonzero(~found.converged))
        raise ValueError(f"targets out of reach: {rows}")
    return TableFile.of(
        target_rows(model, targets, found),
        robot=TableRobot(serial=serial, name=model.robot.name),
        simulated=simulated,
        tool=model.robot.tool,
        source=TableSource(run=run, model_sha256=sha256_of(model.text()), method=method),
        joint_region=valid_region(model),
        created=created,
    )


def table_figures(table: TableFile) -> dict[str, Any]:
    """A table in figures: rows, largest correction (deg); distances predicted before and after, σ (mm)."""
    import numpy as np

    def figures(values: list[float]) -> dict[str, float]:
        array = np.array(values)
        return {"mean": float(array.mean()), "rms": float(np.sqrt(np.mean(array**2))), "max": float(array.max())}

    return {
        "id": table.id,
        "rows": len(table.rows),
        "max_correction_deg": table.max_correction_deg,
        "predicted_before_mm": figures([row.predicted_before_mm for row in table.rows]),
        "predicted_after_mm": figures([row.predicted_after_mm for row in table.rows]),
        "sigma_mm": figures([row.sigma_mm for row in table.rows]),
    }
