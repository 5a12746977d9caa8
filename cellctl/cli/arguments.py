"""Arguments and options that several verbs share."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer


def _procedure(given: Path) -> Path:
    from cellctl.operations.shipped import shipped_file

    return shipped_file("procedure", given)


def _cell(given: Path | None) -> Path | None:
    from cellctl.operations.shipped import shipped_file

    return shipped_file("cell", given) if given else None


def _robot(given: Path | None) -> Path | None:
    from cellctl.operations.shipped import shipped_file

    return shipped_file("robot", given) if given else None


Procedure = Annotated[Path, typer.Argument(help="Procedure file or shipped name.", callback=_procedure)]
Cell = Annotated[Path, typer.Argument(help="Cell file or shipped name.", callback=_cell)]
CellOption = Annotated[Path, typer.Option("--cell", help="Cell file or shipped name.", callback=_cell)]
OtherCell = Annotated[
    Path | None,
    typer.Option("--cell", help="Cell file or shipped name. Default: the procedure's cell.", callback=_cell),
]
ShownCell = Annotated[
    Path | None, typer.Option("--cell", help="Cell file or shipped name: show its controller's tables.", callback=_cell)
]
ComparedCell = Annotated[
    Path | None, typer.Option("--cell", help="Cell file or shipped name: ask its controller too.", callback=_cell)
]
ViewedCell = Annotated[
    Path | None, typer.Option("--cell", help="Cell file or shipped name: the cell to show.", callback=_cell)
]
CheckedCell = Annotated[
    Path | None,
    typer.Option("--cell", help="Cell file or shipped name: checks robot, tool, largest correction.", callback=_cell),
]
Robot = Annotated[
    Path, typer.Argument(help="Robot file (link table, joints, base, tool), or a shipped name.", callback=_robot)
]
RobotOption = Annotated[
    Path | None,
    typer.Option("--robot", help="Robot file or shipped name: checks number and limits of joints.", callback=_robot),
]
TcpRobot = Annotated[
    Path | None,
    typer.Option("--robot", help="Robot file or shipped name: also show changes of the TCP, mm.", callback=_robot),
]
AnyRobot = Annotated[
    Path,
    typer.Argument(
        help="Robot file (.yaml), model (.json), .urdf, DH table (.csv), or shipped name.",
        callback=_robot,
    ),
]
Settings = Annotated[list[str] | None, typer.Option("--set", help="A parameter, name=value; may be repeated.")]
Run = Annotated[Path, typer.Argument(help="Run folder or name.")]
Runs = Annotated[Path, typer.Option("--runs", help="Folder that holds the runs.")]
Json = Annotated[str | None, typer.Option("--json", help="Write the result as JSON to this file; - for stdout.")]
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Output file. Default: stdout.")]
Seed = Annotated[int | None, typer.Option(help="Seed of the simulated robot's errors.", min=0)]


def shown_name(path: Path) -> str:
    """A file's name as text, for any bytes in it."""
    return os.fsencode(path.name).decode(errors="replace")
