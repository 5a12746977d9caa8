"""`cellctl convert`: converts a robot to another program's format."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, final

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.formats.description import RobotDescription
    from cellctl.kinematics import Convention


@final
class Form(StrEnum):
    """Output formats of `convert`."""

    MDH = "mdh-hayati"
    CRAIG = "dh-craig"
    POE = "poe"
    URDF = "urdf"
    DH_CSV = "dh-csv"


@final
class Table(StrEnum):
    """Convention of the rows of a DH table."""

    MDH = "mdh-hayati"
    CRAIG = "dh-craig"


_CONVENTIONS: dict[Form, Convention] = {Form.MDH: "mdh-hayati", Form.CRAIG: "dh-craig", Form.POE: "poe"}


def convert(
    robot: arguments.AnyRobot,
    to: Annotated[Form, typer.Option(help="Form: a robot file in that convention, a URDF, or a DH table.")],
    out: arguments.Out = None,
    tip: Annotated[str | None, typer.Option(help="Last link of the chain in a URDF.")] = None,
    table: Annotated[Table | None, typer.Option(help="Convention of the DH table read or written.")] = None,
    repeatability: Annotated[float | None, typer.Option(help="1 σ, 3-D, mm, if the source has none.")] = None,
    json_: arguments.Json = None,
) -> None:
    """Convert a robot file or model to another form.

    The result has the same TCP at the same joint readings. Of a model only the identified geometry is written, with
    base and tool; these forms have no compliance, thermal expansion or backlash. URDF joints are the controller's
    readings, in radians.

    Example: cellctl convert kr5_r1400 --to urdf -o kr5.urdf
    """
    from cellctl.cli.outputs import refuse_json_on_stdout, refuse_outputs, to_stdout, write_json
    from cellctl.files import write_atomically

    if table is not None and to is not Form.DH_CSV and robot.suffix.lower() != ".csv":
        raise typer.BadParameter("--table is for a DH table (.csv), and none is read or written here")
    refuse_json_on_stdout(json_, out, "the robot")
    refuse_outputs({"--out": out, "--json": json_}, [robot])
    text = _text(_read(robot, tip, table, repeatability), to, table, str(robot))
    if out:
        write_atomically(out, text)
    else:
        to_stdout(text)
    write_json({"robot": str(robot), "form": to.value, "file": str(out) if out else None}, json_)


def _read(path: Path, tip: str | None, table: Table | None, repeatability: float | None) -> RobotDescription:
    from dataclasses import replace

    from cellctl.files import InputError, Problem

    reader = {".urdf": _urdf, ".csv": _table, ".json": _model, ".yaml": _robot, ".yml": _robot}.get(path.suffix.lower())
    if reader is None:
        cure = "its name ends in .yaml (robot file), .json (model), .urdf or .csv (DH table)"
        raise InputError(Problem(str(path), 0, 0, "has a name of no known file type", cure))
    if tip is not None and reader is not _urdf:
        raise typer.BadParameter("--tip names a link of a URDF")
    found = reader(path, tip, table)
    if repeatability is None:
        return found
    if found.repeatability is not None:
        raise typer.BadParameter(f"{path} says its repeatability: {found.repeatability:g} mm")
    return replace(found, repeatability=repeatability)


def _urdf(path: Path, tip: str | None, _: Table | None) -> RobotDescription:
    from cellctl.formats.urdf import load_urdf

    return load_urdf(path, tip)


def _table(path: Path, _: str | None, table: Table | None) -> RobotDescription:
    from cellctl.formats.dh_table import load_dh_table

    return load_dh_table(path, table.value if table else None)


def _robot(path: Path, *_: object) -> RobotDescription:
    from cellctl.formats import RobotFile
    from cellctl.formats.description import RobotDescription

    return RobotDescription.of(RobotFile.load(path))


def _model(path: Path, *_: object) -> RobotDescription:
    from cellctl.formats import ModelFile
    from cellctl.formats.description import RobotDescription

    model = ModelFile.load(path)
    chain = model.robot_model().chain
    besides = [part.name for part in model.parameters if part.name not in chain.parameters and part.value != 0.0]
    if besides:
        typer.echo(f"cellctl: left out, as it is no geometry: {', '.join(besides)}", err=True)
    return RobotDescription.of(model.robot, chain)


def _text(robot: RobotDescription, to: Form, table: Table | None, source: str) -> str:
    from cellctl.formats.dh_table import dh_table_text
    from cellctl.formats.robot_text import robot_text
    from cellctl.formats.urdf_text import urdf_text

    if to in (Form.URDF, Form.DH_CSV) and robot.mounting != "floor":
        typer.echo("cellctl: left out, as this form has no place for it: mounting", err=True)
    if to is Form.URDF:
        return urdf_text(robot)
    if to is Form.DH_CSV:
        own = robot.chain.convention
        return dh_table_text(robot, table.value if table else "mdh-hayati" if own == "poe" else own)
    return robot_text(robot, _CONVENTIONS[to], source)
