"""`cellctl convert`: writes a robot or a model in another program's or controller's form."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, final

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.kinematics import TableConvention


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
    """
    from cellctl.cli.outputs import refuse_json_on_stdout, refuse_outputs, to_stdout, write_json
    from cellctl.files import write_atomically
    from cellctl.operations.exporting import ExportOptions, exported, read_source

    _refuse_options(robot, to, into, tip, table)
    if to is not Form.KUKA and (tool_number, base_number) != (None, None):
        raise typer.BadParameter("--tool-number and --base-number are for --to kuka")
    refuse_json_on_stdout(json_, out, "the robot")
    refuse_outputs({"--out": out, "--json": json_}, [robot, into])
    convention = _TABLES[table] if table else None
    source = read_source(robot, tip if into is None else None, convention, repeatability)
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
