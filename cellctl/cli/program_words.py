"""What `cellctl compensate` tells of a program on the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from cellctl.cli.ends import SHOWN

if TYPE_CHECKING:
    from cellctl.operations.compensated_program import CompensatedProgram
    from cellctl.operations.program_paths import Path as ProgramPath

_TAUGHT = (
    "Only for points made off-line (CAD, calculated). Points taught by hand with this robot contain its error already: "
    "compensated, they would be wrong."
)


def words_of(found: CompensatedProgram, paths: Sequence[ProgramPath], figures: dict[str, Any]) -> Iterator[str]:
    """The lines for the terminal; figures: of the JSON."""
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
        yield f"  {found.file(one)}:{one.line}: {one.words}"
    if len(found.left) > SHOWN:
        yield f"  … and {len(found.left) - SHOWN} more (--json FILE has all)"
    if figures["tool_shift_mm"] is None:
        yield "The errors of the arm are corrected; the tool is taken from the program's data (--arm-only)."
    else:
        yield (
            f"The identified tool is {figures['tool_shift_mm']:.3f} mm from the taught one; the points bring "
            "the identified tool to the program's places."
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
