"""`cellctl compensate MODEL program.src`: the same program with compensated points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import typer

from cellctl.cli.ends import SHOWN

if TYPE_CHECKING:
    from cellctl.operations.compensated_program import CompensatedProgram, Left
    from cellctl.operations.program_files import ProgramFiles
    from cellctl.operations.program_motions import Kind, Program
    from cellctl.operations.program_paths import Path as ProgramPath

_FRAME = 6
_NOT_FOR_PROGRAMS = ("all", "write-back-geometry", "write-back-zeros")
_TAUGHT = (
    "Only for points made off-line (CAD, calculated). Points taught by hand with this robot contain its error already: "
    "compensated, they would be wrong."
)


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
    figures = _figures(found, paths, tolerance, method, list(outputs.values()))
    if json_ != "-":
        for line in _words(found, paths, figures):
            typer.echo(line)
    write_json(figures, json_)


def _refuse_method(method: str) -> None:
    from cellctl.files import InputError, Problem

    if method in _NOT_FOR_PROGRAMS:
        what = f"'{method}' changes no points"
        raise InputError(Problem("--method", 0, 0, what, "for a program: pseudo-target, the default"))


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
    from cellctl.files import InputError, Problem

    problems = [Problem(_file(found, left), left.line, 0, _what(left)) for left in found.left]
    if not problems:
        problems = [Problem(found.program.src.name, 0, 0, "has no motion")]
    return InputError(problems, "no point was compensated, nothing was written")


def _file(found: CompensatedProgram, left: Left) -> str:
    return found.program.parts[left.part].name


def _what(left: Left) -> str:
    return f"{left.name}: {left.reason}" if left.name and not left.reason.startswith(left.name) else left.reason


def _figures(
    found: CompensatedProgram, paths: Sequence[ProgramPath], tolerance: float, method: str, files: list[Path]
) -> dict[str, Any]:
    """All that is known of the compensated program, as JSON."""
    from cellctl.formats.table_making import mean_rms_max

    changed = list(found.changed.values())
    columns = ("correction_mm", "correction_deg", "before_mm", "after_mm")
    return {
        "method": method,
        "compensated": len(changed),
        "left": [
            {"file": _file(found, one), "line": one.line, "name": one.name, "reason": one.reason} for one in found.left
        ],
        **{name: mean_rms_max([getattr(one, name) for one in changed]) for name in columns},
        "points": [
            {
                "file": found.program.parts[one.written.part].name,
                "line": one.written.point.line,
                "name": one.written.point.name,
                "motions": list(one.lines),
                "numbers": {label: float(text) for label, text in one.numbers.items()},
                **{name: getattr(one, name) for name in columns},
                "turn": list(one.turn) if one.turn else None,
            }
            for one in changed
        ],
        "path_tolerance_mm": tolerance,
        "paths": [_path(path) for path in paths],
        "tool_shift_mm": None if found.goals.robots.arm_only else found.goals.robots.tool_shift_mm,
        "files": [str(path) for path in files],
    }


def _path(path: ProgramPath) -> dict[str, Any]:
    def number(value: float) -> float | None:
        return float(value) if math.isfinite(value) else None

    return {
        "line": path.move.line,
        "kind": path.move.statement.kind,
        "before_mm": number(path.before_mm),
        "bound_mm": number(path.final_mm),
        "undivided_mm": number(path.bound_mm),
        "largest_sample_mm": number(path.sampled_mm),
        "at_share": number(path.share),
        "inserted": 0 if path.between is None else len(path.between.sent) - 1,
        "remarks": [*path.remarks, *([path.undivided] if path.undivided else [])],
        "reason": path.reason,
    }


def _words(found: CompensatedProgram, paths: Sequence[ProgramPath], figures: dict[str, Any]) -> Iterator[str]:
    shift, turned, before, after = (
        figures[name] for name in ("correction_mm", "correction_deg", "before_mm", "after_mm")
    )
    made, left = _count(figures["compensated"], "point"), _count(len(found.left), "place")
    yield f"{found.program.src.name}: {made} compensated, {left} left unchanged."
    yield (
        f"The points shift by {shift['mean']:.3f} mm (mean; max {shift['max']:.3f}), "
        f"joints by up to {turned['max']:.3f}°.\n"
        f"Predicted error: {before['mean']:.3f} mm (mean; max {before['max']:.3f}) before, {after['mean']:.4f} mm "
        f"(max {after['max']:.4f}) after."
    )
    yield from _path_words(paths, figures["path_tolerance_mm"])
    for changed in found.changed.values():
        if changed.turn:
            yield f"{changed.written.name}: T {changed.turn[0]} becomes {changed.turn[1]}, as a joint crosses 0."
    if found.left:
        yield "Left as it was:"
    for one in found.left[:SHOWN]:
        yield f"  {_file(found, one)}:{one.line}: {_what(one)}"
    if len(found.left) > SHOWN:
        yield f"  … and {len(found.left) - SHOWN} more (--json FILE has all)"
    if figures["tool_shift_mm"] is None:
        yield "The errors of the arm are corrected; the tool is taken from the program's data (--arm-only)."
    else:
        yield (
            f"The model's tool is {figures['tool_shift_mm']:.3f} mm from the robot file's; the points take the model's "
            "tool to where the program has the tool."
        )
    yield _TAUGHT
    written = ", ".join(figures["files"])
    yield f"Written: {written}" if written else "Nothing was written: give -o FOLDER."


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _path_words(paths: Sequence[ProgramPath], tolerance: float) -> Iterator[str]:
    judged = [path for path in paths if not path.reason]
    if judged:
        most = max(path.before_mm for path in judged), max(path.final_mm for path in judged)
        yield (
            f"Between the points, {len(judged)} LIN and CIRC: the tool leaves the wanted path by at most "
            f"{most[1]:.3f} mm (before: {most[0]:.3f} mm); the tolerance is {tolerance:g} mm."
        )
    listed = [path for path in paths if path.reason or path.remarks or not path.final_mm <= tolerance or path.between]
    for path in listed[:SHOWN]:
        yield f"  line {path.move.line} {path.move.statement.kind}: {_path_state(path, tolerance)}"
    if len(listed) > SHOWN:
        yield f"  … and {len(listed) - SHOWN} more (--json FILE has all)"


def _path_state(path: ProgramPath, tolerance: float) -> str:
    if path.reason:
        return f"not judged: {path.reason}"
    words = [f"within {path.final_mm:.3f} mm"]
    if path.between:
        words.append(f"{_count(len(path.between.sent) - 1, 'point')} inserted")
    elif path.bound_mm > tolerance:
        words.append(path.undivided or "above the tolerance (--insert adds points between)")
    return "; ".join([*words, *(remark for remark in path.remarks if remark != path.undivided)])
