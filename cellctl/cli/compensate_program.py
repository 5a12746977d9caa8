"""`cellctl compensate MODEL program.src`: the same program with compensated points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

import typer

if TYPE_CHECKING:
    from cellctl.operations.compensated_program import CompensatedProgram
    from cellctl.operations.program_files import ProgramFiles
    from cellctl.operations.program_motions import Kind, Program
    from cellctl.operations.program_paths import Path as ProgramPath

_FRAME = 6
_METHODS = ("pseudo-target", "pseudo-target-matrix", "veitschegger-wu", "newton-raphson")


@final
@dataclass(frozen=True)
class ProgramOptions:
    """Options of `compensate` for programs. config: `$config.dat`. tool, base: X,Y,Z,A,B,C. path_tolerance: mm; points
    are inserted where the deviation is larger, if `insert`. arm_only: the tool is the program's.
    """

    config: Path | None = None
    tool: str | None = None
    base: str | None = None
    path_tolerance: float | None = None
    insert: bool = False
    arm_only: bool = False

    def refuse(self) -> None:
        """Raise InputError if any of them is given: the targets are not a program."""
        from cellctl.files import InputError, Problem

        given = [f"--{name.replace('_', '-')}" for name, value in vars(self).items() if value]
        if given:
            raise InputError(Problem(given[0], 0, 0, "is for programs (.src)", "leave it out"))


DEFAULT_TOLERANCE_MM = 0.05


def compensate_program(
    model: Path,
    program: Path,
    method: str,
    out: Path | None,
    cell: Path | None,
    json_: str | None,
    options: ProgramOptions,
) -> None:
    """Compensate the points of `program` and write it to `out`. Raises InputError, also if no point can be changed."""
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.cli.program_words import figures_of, words_of
    from cellctl.files import write_atomically
    from cellctl.operations.program_files import ProgramFiles
    from cellctl.operations.program_text import program_text

    _refuse_method(method)
    files = ProgramFiles.of(program, options.config)
    outputs = files.outputs(out) if out else {}
    read = [model, cell, *files.read]
    refuse_outputs({**{f"--out ({part})": path for part, path in outputs.items()}, "--json": json_}, read)
    found = _compensated(model, files, method, cell, options)
    if not found.changed:
        raise _nothing(found)
    tolerance = DEFAULT_TOLERANCE_MM if options.path_tolerance is None else options.path_tolerance
    paths = _paths(found, tolerance, options.insert, method)
    texts = program_text(found, paths)
    for part, path in outputs.items():
        write_atomically(path, texts["src" if part == "src" else "dat"])
    figures = figures_of(found, paths, tolerance, method, list(outputs.values()))
    if json_ != "-":
        for line in words_of(found, paths, figures):
            typer.echo(line)
    write_json(figures, json_)


def _refuse_method(method: str) -> None:
    from cellctl.files import InputError, Problem

    if method not in _METHODS:
        raise InputError(Problem("--method", 0, 0, f"'{method}' is not for programs", f"one of: {', '.join(_METHODS)}"))


def _compensated(
    model: Path, files: ProgramFiles, method: str, cell: Path | None, options: ProgramOptions
) -> CompensatedProgram:
    from cellctl.devices.cell import TABLE_CORRECTION_DEG
    from cellctl.formats import ModelFile
    from cellctl.operations.compensated_program import compensate_program as compensated
    from cellctl.operations.compensating import CellRobot, refuse_model, refuse_other_cell
    from cellctl.operations.program_motions import Program
    from cellctl.operations.program_robots import ProgramRobots

    tool, base = (_frame(name, getattr(options, name)) for name in ("tool", "base"))
    place = CellRobot.load(cell) if cell else None
    identified = ModelFile.load(model)
    refuse_model(identified, str(files.src))
    if place:
        refuse_other_cell(identified, str(model), place)
    src, dat, configured = files.load()
    program = Program(src, dat, configured, tool, base)
    _refuse_several(program)
    limit = place.correction_deg if place else TABLE_CORRECTION_DEG
    return compensated(program, ProgramRobots(identified, options.arm_only), method=method, limit_deg=limit)


def _refuse_several(program: Program) -> None:
    """Refuse a stated tool or base that would stand for several of the program."""
    from cellctl.files import InputError, Problem

    kinds: tuple[Kind, ...] = ("tool", "base")
    several = {kind: names for kind in kinds if getattr(program, kind) and (names := program.several(kind))}
    if several:
        raise InputError(
            Problem(f"--{kind}", 0, 0, f"the program uses several: {', '.join(names)}", "give --config '$config.dat'")
            for kind, names in several.items()
        )


def _frame(name: str, text: str | None) -> tuple[float, ...] | None:
    from cellctl.files import InputError, Problem

    if text is None:
        return None
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != _FRAME or not all(math.isfinite(number) for number in numbers):
        raise InputError(Problem(f"--{name}", 0, 0, f"'{text}' is not X,Y,Z,A,B,C", "six numbers, mm and degrees"))
    return numbers


def _paths(found: CompensatedProgram, tolerance: float, insert: bool, method: str) -> list[ProgramPath]:
    from cellctl.operations.program_paths import program_paths, with_points_between

    paths = program_paths(found)
    return [with_points_between(found, path, tolerance, method) for path in paths] if insert else paths


def _nothing(found: CompensatedProgram) -> Exception:
    """The error where no point can be compensated: every reason, with its place."""
    from cellctl.cli.program_words import file_of, reason_of
    from cellctl.files import InputError, Problem

    problems = [Problem(file_of(found, left), left.line, 0, reason_of(left)) for left in found.left]
    if not problems:
        problems = [Problem(found.program.src.name, 0, 0, "has no motion")]
    return InputError(problems, "no point was compensated, nothing was written")
