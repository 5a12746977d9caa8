"""`cellctl import` and `convert`: measured data, robots and models in their forms."""

from __future__ import annotations

import asyncio
from enum import StrEnum
from pathlib import Path
from typing import Annotated, final

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_json_on_stdout, refuse_outputs, to_stdout, write_json
from cellctl.cli.exit_codes import SHOWN
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import RobotFile
from cellctl.formats.dataset import text_of
from cellctl.kinematics import TableConvention
from cellctl.operations.controller_calibration import controller_source, is_cell
from cellctl.operations.exporting import ExportOptions, exported, read_source
from cellctl.pendant_import import Imported, choices, imported, imported_targets


def import_data(
    joints: Annotated[
        Path, typer.Argument(help="Joints: KRL, RAPID, FANUC .LS, UR script, $AXIS_ACT listing, or table.")
    ],
    positions: Annotated[
        Path | None,
        typer.Argument(help="Measured X, Y, Z: table, instrument's text. Omit it if the joint table has them."),
    ] = None,
    out: arguments.Out = None,
    robot: arguments.RobotOption = None,
    decimal: Annotated[str | None, typer.Option(help="Decimal sign, if ambiguous: comma|point.")] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of X, Y, Z, if no heading names it: mm|m|cm|um|inch.")] = None,
    angles: Annotated[str | None, typer.Option(help="Unit of the joints, if ambiguous: deg|rad.")] = None,
    pair: Annotated[str | None, typer.Option(help="Pair the rows of both files by: name|order.")] = None,
    orientation: Annotated[
        str | None,
        typer.Option(help="Take orientations too: abc (KUKA), quaternion, fixed-xyz, euler-xyz, rotation-vector."),
    ] = None,
    columns: Annotated[
        list[str] | None, typer.Option(help="Name columns: --columns A1=shoulder,X=north (may be repeated).")
    ] = None,
    repeats: Annotated[
        bool, typer.Option("--repeats", help="A point may have several rows (repeated measurements).")
    ] = False,
    targets: Annotated[
        bool, typer.Option("--targets", help="Make a target file for `compensate` from Cartesian points.")
    ] = False,
    j3: Annotated[
        str | None, typer.Option(help="FANUC: J3 counts from the horizontal, or from the arm before: horizontal|arm.")
    ] = None,
    coverage: Annotated[float | None, typer.Option(help="How many σ the columns Ux, Uy, Uz are.")] = None,
    group: Annotated[str | None, typer.Option(help="Take the points of this group only.")] = None,
    frame: Annotated[str | None, typer.Option(help="With --targets: take the points in this frame only.")] = None,
    json_: arguments.Json = None,
) -> None:
    """Make a data set from joint list and measured positions, or targets from a program.

    For an instrument that is not connected to the robot.

    Nothing is guessed. All decisions, and rows without a partner, are printed on stderr. Ambiguous input (1,234; mm or
    m; which rows are pairs) is refused, with the option that resolves it.

    Example: cellctl import messung.dat positions.csv --robot kr5_r1400 -o data.csv

    Example: cellctl import part.mod --targets -o targets.csv
    """
    refuse_json_on_stdout(json_, out, "the target file" if targets else "the data set")
    refuse_outputs({"--out": out, "--json": json_}, [joints, positions, robot])
    given = {"decimal": decimal, "unit": unit, "angles": angles, "pair": pair, "orientation": orientation, "j3": j3}
    of_joints = {"POSITIONS": positions, "--robot": robot, "--angles": angles, "--pair": pair, "--j3": j3}
    _refuse_without_meaning(targets, {**of_joints, "--repeats": repeats or None}, frame)
    answers = choices(given, columns or (), repeats=repeats, coverage=coverage, group=group, frame=frame)
    if targets:
        result = imported_targets(joints, answers)
    else:
        result = imported(joints, positions, answers, RobotFile.load(robot) if robot else None)
    text = text_of(result.records)
    if out:
        write_atomically(out, text)
    elif json_ != "-":
        to_stdout(text)
    typer.echo(_words(result, out, "target" if targets else "row"), err=True)
    left = [{"file": row.file, "line": row.line, "name": row.name, "reason": row.reason} for row in result.left_out]
    write_json({"rows": len(result.records), "decided": list(result.decided), "left_out": left}, json_)


def _refuse_without_meaning(targets: bool, for_joints: dict[str, object], frame: str | None) -> None:
    """Raise InputError for options of joints beside --targets, and for --frame without it."""
    if not targets and frame is not None:
        raise InputError(Problem("--frame", 0, 0, "has a meaning for targets only", "give --targets too"))
    given = [name for name, value in for_joints.items() if value is not None] if targets else []
    if given:
        raise InputError(
            Problem(name, 0, 0, "has no meaning with --targets", "cellctl import POINTS --targets -o targets.csv")
            for name in given
        )


def _words(result: Imported, out: Path | None, what: str) -> str:
    count = len(result.records)
    lines = [
        f"{out or ('targets' if what == 'target' else 'data set')}: {count} {what}{'s' * (count != 1)}",
        *(f"  {each}" for each in result.decided),
    ]
    if result.left_out:
        lines += [f"Left out, {len(result.left_out)}:", *(f"  {row}" for row in result.left_out[:SHOWN])]
    if len(result.left_out) > SHOWN:
        lines.append(f"  … and {len(result.left_out) - SHOWN} more (--json names them all)")
    return "\n".join(lines)


@final
class Form(StrEnum):
    """Output forms of `convert`."""

    MDH = "mdh-hayati"
    CRAIG = "dh-craig"
    POE = "poe"
    URDF = "urdf"
    DH_CSV = "dh-csv"
    UR = "ur-calibration"
    KUKA = "kuka"
    ABB = "abb"
    FANUC = "fanuc"


@final
class Table(StrEnum):
    """Convention of the rows of a DH table."""

    MDH = "mdh-hayati"
    CRAIG = "dh-craig"


_TABLES: dict[Table, TableConvention] = {Table.MDH: "mdh-hayati", Table.CRAIG: "dh-craig"}
_INTO = (Form.URDF, Form.UR)


def convert(
    robot: arguments.AnyRobot,
    to: Annotated[Form, typer.Option(help="Form: robot file in a convention, or that of another program.")],
    out: arguments.Out = None,
    into: Annotated[
        Path | None,
        typer.Option(help="Your URDF: keep it, replace its joint origins. Or your UR calibration: keep its hash."),
    ] = None,
    tip: Annotated[str | None, typer.Option(help="Last link of the chain in a URDF (read, or --into).")] = None,
    table: Annotated[Table | None, typer.Option(help="Convention of the DH table read or written.")] = None,
    repeatability: Annotated[float | None, typer.Option(help="1 σ, 3-D, mm, if the source has none.")] = None,
    sheet: arguments.SheetRobot = None,
    tool_number: Annotated[
        int | None, typer.Option(help="n of TOOL_DATA[n] (KUKA). Default: 1.", min=1, max=128)
    ] = None,
    base_number: Annotated[
        int | None, typer.Option(help="n of BASE_DATA[n] (KUKA). Default: 1.", min=1, max=128)
    ] = None,
    json_: arguments.Json = None,
) -> None:
    """Convert a robot file or model to another form.

    mdh-hayati, dh-craig, poe, urdf and dh-csv have the same TCP at the same readings; so has ur-calibration, without
    base and tool. kuka, abb and fanuc are joint zeros, which need a model. What a form cannot hold is named on stderr;
    of a model with effects the form nearest to the whole model is written, and its distance stated. URDF joints are the
    controller's readings, in radians.

    Example: cellctl convert kr5_r1400 --to urdf -o kr5.urdf

    Example: cellctl convert calibration.conf --robot ur10e --to mdh-hayati -o my_ur10e.yaml

    Asked from a UR's controller: cellctl convert my_cell.yaml --to mdh-hayati -o my_ur10e.yaml
    """
    _refuse_options(robot, to, into, tip, table)
    if to is not Form.KUKA and (tool_number, base_number) != (None, None):
        raise typer.BadParameter("--tool-number and --base-number are for --to kuka")
    refuse_json_on_stdout(json_, out, "the robot")
    refuse_outputs({"--out": out, "--json": json_}, [robot, into, sheet])
    convention = _TABLES[table] if table else None
    if is_cell(robot):
        if repeatability is not None:
            raise typer.BadParameter("--repeatability is that of the cell's robot file")
        source = asyncio.run(controller_source(robot, sheet))
    else:
        source = read_source(robot, tip if into is None else None, convention, repeatability, sheet)
    made = exported(source, to.value, ExportOptions(convention, into, tip, tool_number or 1, base_number or 1))
    if out:
        write_atomically(out, made.content)
    else:
        to_stdout(made.content)
    for line in made.lines():
        typer.echo(f"cellctl: {line}", err=True)
    result = {"robot": str(robot), "form": to.value, "file": str(out) if out else None}
    cost = made.cost.figures() if made.cost else None
    write_json({**result, "left_out": list(made.left_out), "cost": cost, **made.figures}, json_)


def _refuse_options(robot: Path, to: Form, into: Path | None, tip: str | None, table: Table | None) -> None:
    """Options that are for another form or source."""
    suffix = robot.suffix.lower()
    if table is not None and to is not Form.DH_CSV and suffix != ".csv":
        raise typer.BadParameter("--table is for a DH table (.csv), and none is read or written here")
    if into is not None and (to not in _INTO or suffix != ".json"):
        raise typer.BadParameter("--into is for a model (.json) and --to urdf or --to ur-calibration")
    if tip is not None and suffix != ".urdf" and not (into and to is Form.URDF):
        raise typer.BadParameter("--tip names a link of a URDF, and none is read here")
