"""Arguments and options that several verbs take, alike in all of them."""

from __future__ import annotations

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


Procedure = Annotated[Path, typer.Argument(help="Procedure file, or the name of a shipped one.", callback=_procedure)]
Cell = Annotated[Path, typer.Argument(help="Cell file, or the name of a shipped one.", callback=_cell)]
CellOption = Annotated[Path, typer.Option("--cell", help="Cell file, or the name of a shipped one.", callback=_cell)]
OtherCell = Annotated[
    Path | None,
    typer.Option("--cell", help="Cell file (or shipped name) instead of the one in the procedure.", callback=_cell),
]
ShownCell = Annotated[
    Path | None, typer.Option("--cell", help="Cell file or shipped name: show what its controller has.", callback=_cell)
]
Robot = Annotated[
    Path, typer.Argument(help="Robot file (link table, joints, base, tool), or a shipped name.", callback=_robot)
]
RobotOption = Annotated[
    Path | None,
    typer.Option("--robot", help="Robot file or shipped name: checks number and limits of joints.", callback=_robot),
]
AnyRobot = Annotated[
    Path,
    typer.Argument(
        help="Robot file (.yaml), model (.json), .urdf, DH table (.csv), or the name of a shipped robot.",
        callback=_robot,
    ),
]
Settings = Annotated[list[str] | None, typer.Option("--set", help="A parameter, name=value; may be repeated.")]
Run = Annotated[Path, typer.Argument(help="Run folder, or its name in the folder of runs.")]
Runs = Annotated[Path, typer.Option("--runs", help="Folder of the runs.")]
Json = Annotated[str | None, typer.Option("--json", help="Write the result as JSON to this file; - for stdout.")]
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Write here instead of stdout.")]
Seed = Annotated[int | None, typer.Option(help="Which simulated robot: the seed of its errors.", min=0)]
