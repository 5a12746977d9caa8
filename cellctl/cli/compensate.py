"""`cellctl compensate`: joints that move the identified robot to targets, or a program with compensated points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, refused_rows, to_stdout, write_json
from cellctl.cli.exit_codes import SHOWN, Exit
from cellctl.clock import calendar_time
from cellctl.compensation import METHODS
from cellctl.devices import TABLE_CORRECTION_DEG
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import DataSet, ModelFile
from cellctl.formats.table import JOINT_DECIMALS
from cellctl.formats.table_making import mean_rms_max, row_figures, sigma_among_rows
from cellctl.formats.targets import Targets, read_targets
from cellctl.operations.compensating import (
    Accuracy,
    CellRobot,
    CompensatedTargets,
    MethodFigures,
    compare_methods,
    compensate_targets,
    controller_of_model,
    refuse_other_cell,
)
from cellctl.operations.programs import (
    CompensatedProgram,
    ProgramFigures,
    ProgramOptions,
    compensate_files,
    is_new_folder,
    is_program,
    program_files,
    refuse_method,
)
from cellctl.operations.programs import Path as ProgramPath
from cellctl.operations.results import as_json

if TYPE_CHECKING:
    from rich.table import Table


_TAUGHT = (
    "Only for points made off-line (CAD, calculated). Points taught by hand with this robot contain its error already: "
    "compensated, they would be wrong."
)

_WIDTH = 120
_SHOWN_PASSES = 5

__all__ = ["compensate"]

_ALL = "all"


def compensate(
    model: Annotated[Path, typer.Argument(help="Model file, as a run or `cellctl fit --out` writes it.")],
    targets: Annotated[
        Path,
        typer.Argument(
            help="CSV: X, Y, Z and A, B, C or QW…QZ; A1…An: posture nearby. Or a program: .src (KRL), .script (UR)."
        ),
    ],
    method: Annotated[
        str, typer.Option(help=f"{', '.join(METHODS)}, or all: compare them.", metavar="METHOD")
    ] = "pseudo-target",
    passes: Annotated[
        int | None, typer.Option(min=1, max=50, help="Passes, as published. Default: until 1e-6 mm is left.")
    ] = None,
    cell: arguments.CheckedCell = None,
    out: arguments.Out = None,
    serial: Annotated[str | None, typer.Option(help="Serial of the controller, if no run names it.")] = None,
    json_: arguments.Json = None,
    config: Annotated[
        Path | None, typer.Option(help="KRL program: the controller's $config.dat, with tools, bases.")
    ] = None,
    tool: Annotated[
        str | None, typer.Option(help="Program: its tool, X,Y,Z,A,B,C, where it does not state it.")
    ] = None,
    base: Annotated[str | None, typer.Option(help="KRL program: its base, X,Y,Z,A,B,C, without --config.")] = None,
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

    Of a KRL or URScript program: the same program with compensated points, for -o FOLDER (docs/programs.md).

    `cellctl table push` sends the table to the controller.

    Targets lie in the model's frame. A target out of reach, near a singularity or outside the measured region is
    refused with its line; `--json` has all refused ones. Exit code 1: a program was written, and places in it are not
    compensated. `--method all` writes no targets: it compares the methods.

    Example: cellctl compensate runs/sphere_selfcal-20261121T192433Z/model.json targets.csv -o table.json
    """
    options = ProgramOptions(config, tool, base, path_tolerance, insert, arm_only)
    if is_program(targets):
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
        compare(identified, wanted, str(targets), limit, json_)
        return
    controller = None if _is_csv(out) else controller_of_model(model, identified, serial)
    with refused_rows(json_):
        found = compensate_targets(identified, wanted, str(targets), method=method, passes=passes, correction_deg=limit)
    table = found.table(controller, calendar_time()) if controller else None
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
    given = [name for name, value in (("--passes", passes), ("--serial", serial)) if value is not None]
    if given:
        raise InputError(Problem(name, 0, 0, "is not for programs", "leave it out") for name in given)


def _is_csv(out: Path | None) -> bool:
    return out is not None and out.suffix.lower() == ".csv"


def _refuse(method: str, passes: int | None, out: Path | None, json_: str | None) -> None:
    problems = []
    if method not in (*METHODS, _ALL):
        cure = f"one of: {', '.join(METHODS)}, {_ALL}"
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


def compensate_program(
    model: Path,
    program: Path,
    method: str,
    out: Path | None,
    cell: Path | None,
    json_: str | None,
    options: ProgramOptions,
) -> None:
    """Compensate the points of `program` and write it to `out`. Raises InputError, also if no point can be changed;
    ends with code 1 if some cannot.
    """
    refuse_method(method)
    files = program_files(program, options.config)
    outputs = files.outputs(out) if out else {}
    new = out if out and is_new_folder(out) else None
    written = {} if new else {f"--out ({part})": path for part, path in outputs.items()}
    refuse_outputs({**written, "--json": json_}, [model, cell, *files.read])
    place = CellRobot.load(cell) if cell else None
    identified = ModelFile.load(model)
    with refused_rows(json_):
        found = compensate_files(identified, str(model), files, method, options, place)
    texts = found.texts()
    if new:
        new.mkdir(exist_ok=True)
    for part, path in outputs.items():
        write_atomically(path, texts[part])
    figures = found.figures(list(outputs.values()))
    if json_ != "-":
        for line in words_of(found.program, found.paths, figures):
            typer.echo(line)
    write_json(as_json(figures), json_)
    if left := len(found.program.left):
        what = "1 place is not compensated: it stays" if left == 1 else f"{left} places are not compensated: they stay"
        typer.echo(f"cellctl: {program}: {what} as in the program", err=True)
        raise typer.Exit(Exit.NOT_BETTER)


def words_of(found: CompensatedProgram, paths: Sequence[ProgramPath], figures: ProgramFigures) -> Iterator[str]:
    """The lines for the terminal."""
    shift, turned, before, after = (figures.correction_mm, figures.correction_deg, figures.before_mm, figures.after_mm)
    made, left = _count(figures.compensated, "point"), _count(len(found.left), "place")
    yield f"{found.program.name}: {made} compensated for a {figures.robot}, {left} left unchanged."
    yield (
        f"The points shift by {shift['mean']:.3f} mm (mean; max {shift['max']:.3f}), "
        f"joints by up to {turned['max']:.3f}°.\n"
        f"Predicted error: {before['mean']:.3f} mm (mean; max {before['max']:.3f}) before, {after['mean']:.4f} mm "
        f"(max {after['max']:.4f}) after."
    )
    yield from _path_words(paths, figures.path_tolerance_mm)
    for changed in found.changed.values():
        if changed.turn:
            yield f"{changed.point.title}: T {changed.turn[0]} becomes {changed.turn[1]}, as a joint crosses 0."
    if found.left:
        yield "Left as it was:"
    for one in found.left[:SHOWN]:
        yield f"  {found.file(one)}:{one.line}: {one.words}"
    if len(found.left) > SHOWN:
        yield f"  … and {len(found.left) - SHOWN} more (--json FILE has all)"
    if figures.tool_shift_mm is None:
        yield "The errors of the arm are corrected; the tool is taken from the program's data (--arm-only)."
    else:
        yield (
            f"The identified tool is {figures.tool_shift_mm:.3f} mm from the taught one; the points bring "
            "the identified tool to the program's places."
        )
    yield _TAUGHT
    written = ", ".join(figures.files)
    yield f"Written: {written}" if written else "Nothing was written: give -o FOLDER."


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _path_words(paths: Sequence[ProgramPath], tolerance: float) -> Iterator[str]:
    judged = [path for path in paths if not path.reason]
    if judged:
        most = max(path.before_mm for path in judged), max(path.final_mm for path in judged)
        yield (
            f"Between the points, {len(judged)} LIN and CIRC: the tool leaves the wanted path by at most "
            f"{most[1]:.3f} mm (before: {most[0]:.3f} mm); the tolerance is {tolerance:g} mm."
        )
    listed = [path for path in paths if path.reason or path.remarks or not path.final_mm <= tolerance or path.between]
    for path in listed[:SHOWN]:
        yield f"  line {path.move.line} {path.move.written_kind}: {_path_state(path, tolerance)}"
    if len(listed) > SHOWN:
        yield f"  … and {len(listed) - SHOWN} more (--json FILE has all)"


def _path_state(path: ProgramPath, tolerance: float) -> str:
    if path.reason:
        return f"not judged: {path.reason}"
    words = [f"within {path.final_mm:.3f} mm"]
    if path.between:
        words.append(f"{_count(len(path.between.sent) - 1, 'point')} inserted")
    elif path.bound_mm > tolerance:
        words.append(path.undivided or "above the tolerance (--insert adds points between)")
    return "; ".join([*words, *(remark for remark in path.remarks if remark != path.undivided)])


def compare(model: ModelFile, wanted: Targets, file: str, correction_deg: float, json_: str | None) -> None:
    """Print every method's figures on the targets `wanted`, of `file`, or write them as JSON."""
    found = compare_methods(model, wanted, file, correction_deg)
    if json_ != "-":
        _show(found, file)
    write_json({"file": file, "targets": len(wanted.lines), "methods": [as_json(each) for each in found]}, json_)


def _show(found: Sequence[MethodFigures], file: str) -> None:
    from rich.console import Console  # only for people: 0.1 s

    console = Console(highlight=False)
    console.width = max(console.width, _WIDTH)  # a narrow terminal may fold a line, but not truncate a figure
    console.print(_accuracies(found))
    if any(each.reached for each in found):
        console.print()
        console.print(_passes(found))
    for words in _notes(found):
        console.print(words, markup=False, soft_wrap=True)
    named = list(dict.fromkeys(target for each in found for target in each.unreached))
    for each in named[:SHOWN]:
        typer.echo(f"{file}:{each.line}: {each.reason}", err=True)
    if len(named) > SHOWN:
        typer.echo(f"… and {len(named) - SHOWN} more (--json names them all)", err=True)


def _accuracies(found: Sequence[MethodFigures]) -> Table:
    from rich.table import Table  # only for people: 0.1 s

    table = Table(box=None, pad_edge=False)
    table.add_column("predicted error", no_wrap=True)
    figures = ("mean µm", "RMS", "max", "mean °")
    passes = [f"{form}\n{figure}" for form in ("1 pass", "repeated") for figure in figures]
    for column in ("reached", *passes, "µs per\ntarget"):
        table.add_column(column, justify="right", no_wrap=True)
    if before := next((each.before for each in found if each.before), None):
        table.add_row("nominal joints", "", *_cells(before))
    for each in found:
        repeated = _cells(each.iterated) if each.repeats else ["–"] * 4
        counts, spent = f"{each.reached}/{each.targets}", f"{1e6 * each.seconds_per_target:.0f}"
        table.add_row(each.method, counts, *_cells(each.one_pass), *repeated, spent)
    return table


def _cells(accuracy: Accuracy | None) -> list[str]:
    if accuracy is None:
        return ["–"] * 4
    lengths = [f"{1000.0 * accuracy.position_mm[name]:.4g}" for name in ("mean", "rms", "max")]
    return [*lengths, f"{accuracy.orientation_deg['mean']:.2g}"]


def _passes(found: Sequence[MethodFigures]) -> Table:
    """Mean error before the first pass and after each: figure 5 of the comparison that the methods are from."""
    from rich.table import Table  # only for people: 0.1 s

    most = min(max((len(each.per_pass_mm) for each in found), default=0), _SHOWN_PASSES + 1)
    table = Table(box=None, pad_edge=False)
    table.add_column("mean error, µm, after pass", no_wrap=True)
    for number in range(most):
        table.add_column(str(number), justify="right", no_wrap=True)
    for each in found:
        if each.repeats:
            table.add_row(each.method, *(f"{1000.0 * value:.3g}" for value in each.per_pass_mm[:most]))
    return table


def _notes(found: Sequence[MethodFigures]) -> Iterator[str]:
    if names := [each.method for each in found if each.position_only]:
        yield f"{', '.join(names)}: position only; the orientation is the nominal robot's."
    if names := [each.method for each in found if not each.repeats]:
        yield f"{', '.join(names)}: parameters in the controller; what is left is the rest of the model."
