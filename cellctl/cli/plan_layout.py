"""`cellctl plan --layout`: where spheres, instrument and nests of a cell should be."""

from __future__ import annotations

from pathlib import Path

import typer

from cellctl.cli.arguments import to_stdout, write_json
from cellctl.files import write_atomically
from cellctl.formats import RobotFile
from cellctl.operations.layout_plan import Layout, layouts
from cellctl.operations.results import as_json


def plan_layout(
    cell: Path, robot: RobotFile, rows: int, places: int, seed: int, out: Path | None, json_: str | None
) -> None:
    """Print a table of each layout, and write the lines of the cell file. Raises InputError."""
    found = layouts(cell, robot, rows, places, seed)
    lines: list[str] = []
    for each in found:
        begins = each.lines[0] not in lines
        lines += [*each.lines[: int(begins)], f"  # {each.what}: {_gain(each)}", *each.lines[1:]]
    text = "".join(f"{line}\n" for line in lines)
    if out:
        write_atomically(out, text)
        if json_ != "-":
            typer.echo(
                "\n".join([*(line for each in found for line in _table(each, rows)), f"Lines for {cell}: {out}"])
            )
    elif json_ != "-":
        to_stdout(text)
    write_json({"layouts": [as_json(each) for each in found], "file": str(out) if out else None}, json_)


def _table(layout: Layout, rows: int) -> list[str]:
    where = "" if layout.what == "nests" else f", the best {rows} rows at each"
    lines = [f"{layout.what}: {layout.tried} possible places{where}. {_gain(layout)}"]
    return lines + [
        f"  {one.name}: {_place(one.today)} → {_place(one.planned)}{'' if one.moved else ' (stays)'}"
        for one in layout.moved
    ]


def _gain(layout: Layout) -> str:
    of = "turn and shift of the instrument" if layout.what == "nests" else "fit"
    if layout.today_mm is None:
        return f"Predicted 1 σ (3-D) by the {of}: {layout.planned_mm:.3f} mm; today's places cannot be used."
    gain = f"{100.0 * (1.0 - layout.planned_mm / layout.today_mm):.0f} % less"
    return f"Predicted 1 σ (3-D) by the {of}: {layout.planned_mm:.3f} mm, today {layout.today_mm:.3f} mm ({gain})."


def _place(xyz: list[float]) -> str:
    return ", ".join(f"{value:.0f}" for value in xyz)
