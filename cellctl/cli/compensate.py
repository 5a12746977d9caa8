"""`cellctl compensate`: computes joints that move the identified robot to targets, as a controller's table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.formats import TableFile

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
    from cellctl.clock import calendar_time
    from cellctl.formats import DataSet, ModelFile
    from cellctl.formats.table_making import sigma_among_rows, table_figures
    from cellctl.formats.targets import read_targets
    from cellctl.operations.compensating import compensate_targets
    from cellctl.operations.learnt_on import learnt_on

    _refuse(method, out, json_)
    refuse_outputs({"--out": out, "--json": json_}, [model, targets])
    identified = ModelFile.load(model)
    wanted = read_targets(DataSet.load(targets), identified.robot)
    learnt = learnt_on(model, identified, serial)
    found = compensate_targets(identified, wanted, str(targets), method=method)
    table = found.table(learnt, calendar_time())
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
