"""`cellctl import`: a pendant's joint list and a table of positions typed by hand become a data set."""

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
        Path | None, typer.Argument(help="Table of measured X, Y, Z. Left out: the joint table holds them too.")
    ] = None,
    out: arguments.Out = None,
    robot: arguments.RobotOption = None,
    decimal: Annotated[
        str | None, typer.Option(help="Decimal sign, where the numbers leave it open: comma|point.")
    ] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of X, Y, Z where no heading says: mm|m|cm|um|inch.")] = None,
    angles: Annotated[str | None, typer.Option(help="Unit of the joints where it is open: deg|rad.")] = None,
    pair: Annotated[str | None, typer.Option(help="Which rows belong together: by name|order.")] = None,
    orientation: Annotated[
        str | None, typer.Option(help="Take A, B, C (abc: KUKA's Rz Ry Rx, deg) or QW…QZ (quaternion) too.")
    ] = None,
    columns: Annotated[
        list[str] | None, typer.Option(help="Name columns: --columns A1=shoulder,X=north (again for more).")
    ] = None,
    repeats: Annotated[
        bool, typer.Option("--repeats", help="Several measurements of a point are several rows.")
    ] = False,
    json_: arguments.Json = None,
) -> None:
    """Make a data set of a joint list and a table of positions, for an instrument that is wired to nothing.

    Nothing is guessed: what was decided, and every row that is in no pair, is said on stderr; what the files leave
    open (1,234; mm or m; which rows belong together) is refused, with the option that answers it.

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
