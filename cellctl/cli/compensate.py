"""`cellctl compensate`: computes joints that move the identified robot to targets, as a controller's table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.files import Problem
    from cellctl.formats import ModelFile, TableFile
    from cellctl.formats.targets import Targets
    from cellctl.kinematics import Bools
    from cellctl.operations.learnt_on import LearntOn

__all__ = ["compensate"]


def compensate(
    model: Annotated[Path, typer.Argument(help="Model file, as a run or `cellctl fit --out` writes it.")],
    targets: Annotated[Path, typer.Argument(help="CSV: X, Y, Z and A, B, C or QW…QZ; A1…An: posture nearby.")],
    method: Annotated[
        str, typer.Option(help="pseudo-target (the default), pseudo-target-matrix, veitschegger-wu, newton-raphson.")
    ] = "pseudo-target",
    out: arguments.Out = None,
    serial: Annotated[str | None, typer.Option(help="Serial of the controller, if no run names it.")] = None,
    json_: arguments.Json = None,
) -> None:
    """Compute compensated joints for targets, as a table.

    `cellctl table push` sends the table to the controller.

    Targets lie in the model's frame. A target out of reach or outside the measured region is refused.

    Example: cellctl compensate runs/sphere_selfcal-20261121T192433Z/model.json targets.csv -o table.json
    """
    from cellctl.cli.outputs import refuse_outputs, to_stdout, write_json
    from cellctl.formats import DataSet, ModelFile
    from cellctl.formats.table_making import sigma_among_rows, table_figures
    from cellctl.formats.targets import read_targets
    from cellctl.operations.learnt_on import learnt_on

    _refuse(method, out, json_)
    refuse_outputs({"--out": out, "--json": json_}, [model, targets])
    identified = ModelFile.load(model)
    wanted = read_targets(DataSet.load(targets), identified.robot)
    table = _table(identified, wanted, str(targets), method, learnt_on(model, identified, serial))
    figures = {**table_figures(table), "sigma_among_rows_mm": sigma_among_rows(identified, table)}
    if out:
        table.save(out)
        if json_ != "-":
            typer.echo(_words(table, figures, out))
    elif json_ != "-":
        to_stdout(table.text())
    write_json({**figures, "file": str(out) if out else None}, json_)


def _refuse(method: str, out: Path | None, json_: str | None) -> None:
    from cellctl.files import InputError, Problem

    # not imported from the mathematics: errors in the call are reported without loading it
    known = ("pseudo-target", "pseudo-target-matrix", "veitschegger-wu", "newton-raphson")
    problems = []
    if method not in known:
        problems.append(Problem("--method", 0, 0, f"'{method}' is not known", f"one of: {', '.join(known)}"))
    if json_ == "-" and out is None:
        problems.append(Problem("--json", 0, 0, "the table itself goes to stdout", "give -o TABLE.json too"))
    if problems:
        raise InputError(problems)


def _table(model: ModelFile, wanted: Targets, file: str, method: str, learnt: LearntOn) -> TableFile:
    """The table of all targets. Raises InputError with every target out of reach or outside the measured region."""
    import numpy as np

    from cellctl.calibration import MotorTorsion
    from cellctl.clock import calendar_time
    from cellctl.files import InputError, Problem
    from cellctl.formats.table_making import compensated_targets, table_of, usual_postures

    loads = model.load_region
    if loads and loads.min < loads.max and loads.min > 0.0:
        what = f"the model was identified with {loads.min:g} … {loads.max:g} kg, and a table is for no payload"
        raise InputError(Problem(file, 0, 0, what, "identify from rows without payload too"))
    if any(isinstance(effect, MotorTorsion) for effect in model.robot_model().effects):
        what = "the model includes the flexibility by motor current, and a target has no current"
        cure = "identify with --model geometry+compliance, and +backlash where the side of approach is known"
        raise InputError(Problem(file, 0, 0, what, cure))
    postures = wanted.postures if wanted.postures is not None else usual_postures(model, wanted.poses)
    started = np.asarray(np.isfinite(postures).all(axis=1))
    found = compensated_targets(model, wanted.poses, np.where(started[:, None], postures, 0.0), method=method)
    reached = np.logical_and(started, found.converged)
    if not reached.all():
        raise InputError(_unreachable(wanted, file, reached))
    table = table_of(
        model,
        wanted.poses,
        found,
        serial=learnt.serial,
        simulated=learnt.simulated,
        run=learnt.run,
        created=calendar_time(),
        method=method,
    )
    problems = _outside(model, wanted, file, table)
    if problems:
        raise InputError(problems)
    return table


def _unreachable(wanted: Targets, file: str, reached: Bools) -> list[Problem]:
    from cellctl.files import Problem

    cure = "move the target, or give a posture near it as A1…An"
    return [
        Problem(file, line, 0, "the target is out of the robot's reach", cure)
        for line, reachable in zip(wanted.lines, reached, strict=True)
        if not reachable
    ]


def _outside(model: ModelFile, wanted: Targets, file: str, table: TableFile) -> list[Problem]:
    """Errors in rows that must not be sent to a controller of this robot."""
    from cellctl.files import Problem
    from cellctl.formats.table_refusals import row_problems

    cure = "move the target, or give another posture for it as A1…An"
    return [
        Problem(file, wanted.lines[row], 0, what, cure)
        for row, reasons in enumerate(row_problems(table, model.robot))
        for what in reasons
    ]


def _words(table: TableFile, figures: dict[str, Any], out: Path) -> str:
    before, after, sigma = (figures[name] for name in ("predicted_before_mm", "predicted_after_mm", "sigma_mm"))
    among = figures["sigma_among_rows_mm"]
    return (
        f"{out}: table {table.id[:12]} for controller {table.robot.serial}, {figures['rows']} rows, "
        f"joints corrected by up to {figures['max_correction_deg']:.3f}°.\n"
        f"Predicted error in the model's frame: {before['mean']:.3f} mm (mean; max {before['max']:.3f}) "
        f"with nominal joints, {after['mean']:.4f} mm with these.\n"
        f"1 σ of the model (RMS): {sigma['rms']:.3f} mm in its frame"
        + (f", {among:.3f} mm among the rows." if among is not None else ".")
    )
