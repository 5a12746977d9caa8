"""`cellctl import`: makes a data set from a pendant's joint list and a hand-typed table of positions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.ends import SHOWN

if TYPE_CHECKING:
    from cellctl.pendant_import import Imported


def import_data(
    joints: Annotated[Path, typer.Argument(help="Joint list: KRL (.dat), $AXIS_ACT listing, UR script, or table.")],
    positions: Annotated[
        Path | None, typer.Argument(help="Table of measured X, Y, Z. Omit it if the joint table has them.")
    ] = None,
    out: arguments.Out = None,
    robot: arguments.RobotOption = None,
    decimal: Annotated[str | None, typer.Option(help="Decimal sign, if ambiguous: comma|point.")] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of X, Y, Z, if no heading names it: mm|m|cm|um|inch.")] = None,
    angles: Annotated[str | None, typer.Option(help="Unit of the joints, if ambiguous: deg|rad.")] = None,
    pair: Annotated[str | None, typer.Option(help="Pair the rows of both files by: name|order.")] = None,
    orientation: Annotated[
        str | None, typer.Option(help="Take orientations too: abc (KUKA, Rz Ry Rx, deg) or quaternion (QW…QZ).")
    ] = None,
    columns: Annotated[
        list[str] | None, typer.Option(help="Name columns: --columns A1=shoulder,X=north (may be repeated).")
    ] = None,
    repeats: Annotated[
        bool, typer.Option("--repeats", help="A point may have several rows (repeated measurements).")
    ] = False,
    json_: arguments.Json = None,
) -> None:
    """Make a data set from joint list and measured positions.

    For an instrument that is not connected to the robot.

    Nothing is guessed. All decisions, and rows without a partner, are printed on stderr. Ambiguous input (1,234; mm or
    m; which rows are pairs) is refused, with the option that resolves it.

    Example: cellctl import messung.dat positions.csv --robot kr5_r1400 -o data.csv
    """
    from cellctl.cli.outputs import refuse_json_on_stdout, refuse_outputs, to_stdout, write_json
    from cellctl.files import write_atomically
    from cellctl.formats import RobotFile
    from cellctl.formats.dataset import text_of
    from cellctl.pendant_import import choices, imported

    refuse_json_on_stdout(json_, out, "the data set")
    refuse_outputs({"--out": out, "--json": json_}, [joints, positions, robot])
    given = {"decimal": decimal, "unit": unit, "angles": angles, "pair": pair, "orientation": orientation}
    answers = choices(given, columns or (), repeats=repeats)
    result = imported(joints, positions, answers, RobotFile.load(robot) if robot else None)
    text = text_of(result.records)
    if out:
        write_atomically(out, text)
    elif json_ != "-":
        to_stdout(text)
    typer.echo(_words(result, out), err=True)
    left = [{"file": row.file, "line": row.line, "name": row.name, "reason": row.reason} for row in result.left_out]
    write_json({"rows": len(result.records), "decided": list(result.decided), "left_out": left}, json_)


def _words(result: Imported, out: Path | None) -> str:
    count = len(result.records)
    lines = [f"{out or 'data set'}: {count} row{'s' * (count != 1)}", *(f"  {each}" for each in result.decided)]
    if result.left_out:
        lines += [f"Left out, {len(result.left_out)}:", *(f"  {row}" for row in result.left_out[:SHOWN])]
    if len(result.left_out) > SHOWN:
        lines.append(f"  … and {len(result.left_out) - SHOWN} more (--json names them all)")
    return "\n".join(lines)
