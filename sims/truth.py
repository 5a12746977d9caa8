"""`python -m sims truth`: true TCP or reflector of the simulated robot for rows of joints; for tests and studies."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, final

from sims.cell import CellError, read_cell
from sims.cell_content import SimCell
from sims.conditions import REFERENCE_C, Conditions

if TYPE_CHECKING:
    from sims.world import World

TEMPERATURE = "temperature"
PAYLOAD = "payload"
PAYLOAD_AT = ("payload_x", "payload_y", "payload_z")


class TruthError(Exception):
    """The joints cannot be read, or the robot cannot stand there; the text says where and why."""


@final
@dataclass(frozen=True, slots=True)
class Row:
    """Readings A1…An, degrees, and where they are written: `joints.csv:7`."""

    place: str
    readings: list[float]
    conditions: Conditions


def read_rows(stream: TextIO, name: Path, axes: int) -> Iterator[Row]:
    """Rows with A1…An, and as there are: D1…Dn, temperature, payload, payload_x…z; others are passed over.

    Raises TruthError. An empty cell of those further columns is what it would be without the column.
    """
    rows = csv.reader(stream)
    header = [cell.strip() for cell in next(rows, [])]
    joints = _numbered(header, "A", axes, name)
    directions = _numbered(header, "D", axes, name) if any(re.fullmatch(r"D[1-9][0-9]*", one) for one in header) else []
    for name_of in (TEMPERATURE, PAYLOAD, *PAYLOAD_AT):
        if header.count(name_of) > 1:
            raise TruthError(f"{name}:1: column {name_of} is there more than once")
    for cells in rows:
        if cells:
            found = _Cells(f"{name}:{rows.line_num}", dict(zip(header, cells, strict=False)))
            yield Row(found.place, [found.degrees(joint) for joint in joints], found.conditions(directions))


def _numbered(header: Sequence[str], letter: str, axes: int, name: Path) -> list[str]:
    """Columns A1…An in their order, each there once. Raises TruthError."""
    wanted = [f"{letter}{axis}" for axis in range(1, axes + 1)]
    found = [column for column in header if re.fullmatch(rf"{letter}[1-9][0-9]*", column)]
    if sorted(found, key=lambda column: int(column[1:])) != wanted:
        raise TruthError(
            f"{name}:1: columns {wanted[0]}…{wanted[-1]} are expected, each once; "
            f"there are {', '.join(header) or 'none'}"
        )
    return wanted


@final
class _Cells:
    """One row's cells by column."""

    def __init__(self, place: str, texts: dict[str, str]) -> None:
        self.place = place
        self._texts = texts

    def degrees(self, joint: str) -> float:
        number = self._number(joint)
        if number is None:
            raise self._wrong(joint, "a number of degrees")
        return number

    def conditions(self, directions: Sequence[str]) -> Conditions:
        temperature = self._given(TEMPERATURE, REFERENCE_C, "a number of °C")
        directed = tuple(self._direction(column) for column in directions)
        if not self._filled(PAYLOAD):
            return Conditions(directed, temperature)
        payload = self._given(PAYLOAD, 0.0, "a number of kg")
        if payload < 0.0:
            raise self._wrong(PAYLOAD, "at least 0 kg")
        return Conditions(directed, temperature, payload, self._payload_at())

    def _payload_at(self) -> tuple[float, float, float] | None:
        if not any(map(self._filled, PAYLOAD_AT)):
            return None
        x, y, z = (self._number(column) for column in PAYLOAD_AT)
        if x is None or y is None or z is None:
            raise TruthError(f"{self.place}: payload_x, payload_y, payload_z are three numbers of mm, or all empty")
        return x, y, z

    def _filled(self, column: str) -> bool:
        return bool(self._texts.get(column, "").strip())

    def _direction(self, column: str) -> int:
        direction = self._given(column, 0.0, "1, -1 or 0")
        if direction not in {1.0, -1.0, 0.0}:
            raise self._wrong(column, "1, -1 or 0")
        return int(direction)

    def _given(self, column: str, default: float, what: str) -> float:
        """The number there, or the default where nothing is."""
        if not self._filled(column):
            return default
        number = self._number(column)
        if number is None:
            raise self._wrong(column, what)
        return number

    def _number(self, column: str) -> float | None:
        try:
            number = float(self._texts.get(column, ""))
        except ValueError:
            return None
        return number if math.isfinite(number) else None

    def _wrong(self, column: str, what: str) -> TruthError:
        return TruthError(f"{self.place}: {column} is {what}, not '{self._texts.get(column, '')}'")


Ask = Callable[[Sequence[float], Conditions], tuple[float, ...]]


def write_truth(
    cell_file: Path, joints_file: Path, seed: int | None, out: Path, *, pose: bool = False, reflector: str | None = None
) -> int:
    """The true mean TCP in the robot's base frame, mm, at each row's A1…An (deg), as CSV. Returns the number of rows.

    `pose`: A, B, C of the tool too, degrees. `reflector`: the true place of this one on the robot instead of the TCP.
    Raises CellError, TruthError, OSError. Nothing is written unless every row can be.
    """
    from sims.world import World  # numpy

    cell = read_cell(cell_file)
    seed = cell.simulate.seed if seed is None else seed
    cell = replace(cell, simulate=replace(cell.simulate, seed=seed))
    world = World(cell, seed)
    ask: Ask = world.true_pose if pose else world.true_tcp
    if reflector is not None:
        ask = _asking_for(reflector, cell, world)
    with joints_file.open(encoding="utf-8-sig", newline="") as stream:
        rows = list(read_rows(stream, joints_file, len(cell.robot.joints)))
    places = [_asked(ask, row) for row in rows]
    with out.open("w", encoding="utf-8", newline="") as target:
        writer = csv.writer(target, lineterminator="\n")
        writer.writerow("XYZABC" if pose else "XYZ")
        writer.writerows([f"{value:.6f}" for value in place] for place in places)
    return len(rows)


def _asking_for(name: str, cell: SimCell, world: World) -> Ask:
    """Gives the true place of a reflector on the robot. Raises CellError: the cell has none of this name."""
    from sims.world.true_places import TrueReflectors  # numpy

    names = [one.id for one in cell.reflectors.on_flange] if cell.reflectors else []
    if cell.reflectors is None or name not in names:
        raise CellError(
            cell.path, [f"reflectors: no reflector '{name}' on the robot; it has {', '.join(names) or 'none'}"]
        )
    true = TrueReflectors(cell.reflectors, cell.simulate.seed, cell.simulate.errors["reflector"])
    rank = names.index(name)
    return lambda readings, conditions: true.at(world.true_flange(readings, conditions), 0.0)[rank].xyz


def _asked(ask: Ask, row: Row) -> tuple[float, ...]:
    try:
        return ask(row.readings, row.conditions)
    except ArithmeticError as error:
        raise TruthError(f"{row.place}: {error}") from None
