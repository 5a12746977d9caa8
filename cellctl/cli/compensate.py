"""`cellctl compensate`: computes joints that move the identified robot to targets, as a table or as CSV."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import arguments
from cellctl.cli.compensate_program import compensate_program
from cellctl.operations.program_compensation import ProgramOptions

if TYPE_CHECKING:
    from cellctl.operations.compensating import CompensatedTargets

__all__ = ["compensate"]

_ALL = "all"
_METHODS = (
    "pseudo-target",
    "pseudo-target-matrix",
    "veitschegger-wu",
    "newton-raphson",
    "cyclic-search",
    "write-back-geometry",
    "write-back-zeros",
)  # not imported from the mathematics: errors in the call are reported without loading it


def compensate(
    model: Annotated[Path, typer.Argument(help="Model file, as a run or `cellctl fit --out` writes it.")],
    targets: Annotated[
        Path,
        typer.Argument(help="CSV: X, Y, Z and A, B, C or QW…QZ; A1…An: posture nearby. Or a KRL program (.src)."),
    ],
    method: Annotated[
        str, typer.Option(help=f"{', '.join(_METHODS)}, or all: compare them.", metavar="METHOD")
    ] = "pseudo-target",
    passes: Annotated[
        int | None, typer.Option(min=1, max=50, help="Passes, as published. Default: until 1e-6 mm is left.")
    ] = None,
    cell: arguments.CheckedCell = None,
    out: arguments.Out = None,
    serial: Annotated[str | None, typer.Option(help="Serial of the controller, if no run names it.")] = None,
    json_: arguments.Json = None,
    config: Annotated[
        Path | None, typer.Option(help="Program: the controller's $config.dat, with tools, bases.")
    ] = None,
    tool: Annotated[str | None, typer.Option(help="Program: its tool, X,Y,Z,A,B,C, without --config.")] = None,
    base: Annotated[str | None, typer.Option(help="Program: its base, X,Y,Z,A,B,C, without --config.")] = None,
    path_tolerance: Annotated[
        float | None, typer.Option(min=0.001, help="Program: largest deviation on LIN and CIRC, mm. Default: 0.05.")
    ] = None,
    insert: Annotated[
        bool, typer.Option("--insert", help="Program: add points on LIN and CIRC that leave the tolerance.")
    ] = False,
    arm_only: Annotated[
        bool, typer.Option("--arm-only", help="Program: any tool; correct the arm, not the tool.")
    ] = False,
) -> None:
    """Compute compensated joints for targets, as a table, or as CSV for -o FILE.csv.

    Of a KRL program: the same program with compensated points, for -o FOLDER (docs/programs.md).

    `cellctl table push` sends the table to the controller.

    Targets lie in the model's frame. A target out of reach, near a singularity or outside the measured region is
    refused with its line; `--json` has all refused ones. Exit code 1: a program was written, and places in it are not
    compensated. `--method all` writes no targets: it compares the methods.

    Example: cellctl compensate runs/sphere_selfcal-20261121T192433Z/model.json targets.csv -o table.json
    """
    from cellctl.cli.outputs import refuse_outputs, refused_rows, to_stdout, write_json
    from cellctl.clock import calendar_time
    from cellctl.files import write_atomically
    from cellctl.formats import DataSet, ModelFile
    from cellctl.formats.targets import read_targets
    from cellctl.operations.compensating import CellRobot, compensate_targets, learnt_on, refuse_other_cell

    options = ProgramOptions(config, tool, base, path_tolerance, insert, arm_only)
    if targets.suffix.lower() in (".src", ".sub", ".dat"):
        _refuse_for_program(passes, serial)
        compensate_program(model, targets, method, out, cell, json_, options)
        return
    options.refuse()
    _refuse(method, passes, out, json_)
    refuse_outputs({"--out": out, "--json": json_}, [model, targets, cell])
    place = CellRobot.load(cell) if cell else None
    identified = ModelFile.load(model)
    if place:
        refuse_other_cell(identified, str(model), place)
    wanted = read_targets(DataSet.load(targets), identified.robot)
    limit = place.correction_deg if place else math.inf
    if method == _ALL:
        from cellctl.cli.method_table import compare

        compare(identified, wanted, str(targets), limit, json_)
        return
    learnt = None if _is_csv(out) else learnt_on(model, identified, serial)
    with refused_rows(json_):
        found = compensate_targets(identified, wanted, str(targets), method=method, passes=passes, correction_deg=limit)
    table = found.table(learnt, calendar_time()) if learnt else None
    figures = {**({"id": table.id, "serial": table.robot.serial} if table else {}), **_figures(found)}
    text = table.text() if table else found.csv()
    if place is None:
        _warn_large(found, str(targets))
    if out:
        write_atomically(out, text)
        if json_ != "-":
            typer.echo(_words(figures, out))
    elif json_ != "-":
        to_stdout(text)
    write_json({**figures, "file": str(out) if out else None}, json_)


def _refuse_for_program(passes: int | None, serial: str | None) -> None:
    from cellctl.files import InputError, Problem

    given = [name for name, value in (("--passes", passes), ("--serial", serial)) if value is not None]
    if given:
        raise InputError(Problem(name, 0, 0, "is not for programs", "leave it out") for name in given)


def _is_csv(out: Path | None) -> bool:
    return out is not None and out.suffix.lower() == ".csv"


def _refuse(method: str, passes: int | None, out: Path | None, json_: str | None) -> None:
    from cellctl.files import InputError, Problem

    problems = []
    if method not in (*_METHODS, _ALL):
        cure = f"one of: {', '.join(_METHODS)}, {_ALL}"
        problems.append(Problem("--method", 0, 0, f"'{method}' is not known", cure))
    if method == _ALL and out:
        what = "--method all compares the methods and writes no targets"
        problems.append(Problem("--out", 0, 0, what, "leave it out, or choose one method"))
    if method == _ALL and passes is not None:
        what = "--method all shows every method after one pass and repeated"
        problems.append(Problem("--passes", 0, 0, what, "leave it out"))
    if json_ == "-" and out is None and method != _ALL:
        problems.append(Problem("--json", 0, 0, "the table itself goes to stdout", "give -o TABLE.json too"))
    if problems:
        raise InputError(problems)


def _figures(found: CompensatedTargets) -> dict[str, Any]:
    """The targets in figures, in full precision; the orientation predicted by the model, deg. written: what the joints
    as written leave, with their decimals.
    """
    from cellctl.formats.table import JOINT_DECIMALS
    from cellctl.formats.table_making import mean_rms_max, row_figures, sigma_among_rows

    return {
        **row_figures(found.exact_rows),
        "targets": [row.model_dump() for row in found.exact_rows],
        "written": {
            "joint_decimals": JOINT_DECIMALS,
            "predicted_after_mm": mean_rms_max([row.predicted_after_mm for row in found.rows]),
        },
        "sigma_among_rows_mm": sigma_among_rows(found.model, found.rows),
        "method": found.method,
        "passes": found.found.passes,
        "position_only": found.found.position_only,
        "orientation_before_deg": mean_rms_max(found.found.error_deg[0]),
        "orientation_after_deg": mean_rms_max(found.found.error_deg[-1]),
    }


def _warn_large(found: CompensatedTargets, file: str) -> None:
    """Name corrections that a cell would refuse by default: such a posture is near a singularity."""
    from cellctl.devices.cell import TABLE_CORRECTION_DEG

    for line, row in zip(found.wanted.lines, found.rows, strict=True):
        if row.correction_deg > TABLE_CORRECTION_DEG:
            what = (
                f"a joint is corrected by {row.correction_deg:.1f}°; a cell allows {TABLE_CORRECTION_DEG:g}° by default"
            )
            typer.echo(f"cellctl: {file}:{line}: {what}", err=True)


def _words(figures: dict[str, Any], out: Path) -> str:
    before, sigma, written = (figures[name] for name in ("predicted_before_mm", "sigma_mm", "written"))
    after, decimals = written["predicted_after_mm"], written["joint_decimals"]
    among = figures["sigma_among_rows_mm"]
    named = f"table {figures['id'][:12]} for controller {figures['serial']}" if "id" in figures else "targets"
    lines = [
        f"{out}: {named}, {figures['rows']} rows, joints corrected by up to {figures['max_correction_deg']:.3f}°.",
        f"Predicted error in the model's frame: {before['mean']:.3f} mm (mean; max {before['max']:.3f}) "
        f"with nominal joints, {after['mean']:.4f} mm with these, written with {decimals} decimals.",
        f"1 σ of the model (RMS): {sigma['rms']:.3f} mm in its frame"
        + (f", {among:.3f} mm among the rows." if among is not None else "."),
    ]
    if figures["position_only"]:
        turned = figures["orientation_after_deg"]
        lines.append(f"Position only: the orientation is off by {turned['mean']:.3f}° (mean; max {turned['max']:.3f}).")
    return "\n".join(lines)
