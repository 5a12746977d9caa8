"""`cellctl robots`: lists the library of nominal robots, shows one, and writes its file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, to_stdout, write_json
from cellctl.files import write_atomically
from cellctl.operations import robot_library
from cellctl.operations.robot_library import COLUMNS, LibraryRobot


def robots(
    name: Annotated[str | None, typer.Argument(help="Robot to show. Default: list all.")] = None,
    out: Annotated[str | None, typer.Option("-o", "--out", help="Write the robot file to this file.")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="List as a Markdown table, with the sources.")] = False,
    json_: arguments.Json = None,
) -> None:
    """List the robots that a fit, a plan or a cell may name, or show one.

    reach: of the flange from axis 1, within the joint limits. checked: agreement of the flange with a second source.

    Example: cellctl robots kr300_r2500 -o my_robot.yaml
    """
    if name is None and out is not None:
        raise typer.BadParameter("--out writes one robot: name it")
    if name is not None and markdown:
        raise typer.BadParameter("--markdown lists all robots: leave out the name")
    found = [robot_library.LibraryRobot.find(name)] if name else robot_library.robots()
    refuse_outputs({"--out": out, "--json": json_}, [robot.file for robot in found])
    if out is not None:
        write_atomically(Path(out), found[0].file.read_text(encoding="utf-8"))
    if markdown:
        to_stdout(robot_library.markdown(found))
    elif json_ != "-":
        for line in _shown(found[0]) if name else _aligned([robot_library.COLUMNS, *(row.cells for row in found)]):
            typer.echo(line)
    write_json({"robots": [robot.to_json() for robot in found]} if name is None else found[0].to_json(), json_)


def _shown(found: LibraryRobot) -> Iterator[str]:
    yield f"{found.name}: {found.robot.name}"
    yield from (f"  {key:13} {cell}" for key, cell in list(zip(COLUMNS, found.cells, strict=True))[2:5] if cell)
    source = found.source.model_dump(exclude_none=True)
    checked = source.pop("checked")
    if isinstance(checked, dict):
        source |= {"second source": checked["against"], "agreement": found.checked}
    else:
        source["checked"] = checked
    source.pop("payload", None)
    yield from (f"  {key:13} {text}" for key, text in source.items())
    yield f"  file          {found.file}"
    columns = ["joint", "theta", "d", "a", "alpha", "beta", "sign", "offset", "min", "max", "max_speed"]
    rows = zip(found.robot.links, found.robot.joints, strict=True)
    cells = [{**link.model_dump(), **joint.model_dump(), "joint": n} for n, (link, joint) in enumerate(rows, 1)]
    table = [columns, *([_number(row[key]) for key in columns] for row in cells)]
    yield from (f"  {line}" for line in _aligned(table))


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def _aligned(rows: list[tuple[str, ...]] | list[list[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
