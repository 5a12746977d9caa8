"""The text of a compensated program: its files with the new numbers, and the lines of inserted points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from cellctl.compensation.paths import Arc
from cellctl.kinematics import abc_from_rotation, inverse_pose
from cellctl.krl import CARTESIAN, KrlFile, Motion, Span
from cellctl.krl.writing import aggregate_text
from cellctl.operations.compensated_program import CompensatedProgram
from cellctl.operations.program_paths import Path
from cellctl.operations.program_points import Part

if TYPE_CHECKING:
    from cellctl.kinematics import Floats


def program_text(found: CompensatedProgram, paths: Sequence[Path]) -> dict[Part, bytes]:
    """The program's files with the compensated points, and with the points inserted on `paths`."""
    texts = {part: found.values(part) for part in found.program.parts}
    for path in paths:
        if path.between is not None:
            texts["src"] = _replacing(texts["src"], _inserted(found, path))
    return {part: file.replaced(texts[part]) for part, file in found.program.parts.items()}


def _replacing(texts: dict[Span, str], added: Mapping[Span, str]) -> dict[Span, str]:
    """`added` too, in place of the numbers inside its spans."""
    kept = {
        span: text
        for span, text in texts.items()
        if not any(place.start <= span.start and span.end <= place.end for place in added)
    }
    return kept | dict(added)


def _inserted(found: CompensatedProgram, path: Path) -> dict[Span, str]:
    """New lines before the motion; of a circle also a new auxiliary point in its own line."""
    assert path.between is not None
    file, motion, parts = found.program.src, path.move.statement, path.between.sent
    if len(parts) < 2:
        return {}
    base = found.changed[path.move.uses[-1].key].parts[0].goal.base
    assert base is not None
    seen = inverse_pose(base)
    indent, end = _surroundings(file, motion)
    count, bound = len(parts) - 1, path.between.bound_mm.max()
    lines = [
        f"; cellctl: {count} point{'s' * (count > 1)} inserted, the path is within {bound:.3f} mm of the wanted one"
    ]
    for part in parts[:-1]:
        auxiliary = _literal(seen @ part.poses([0.5])[0]) if isinstance(part, Arc) else ""
        lines.append(_line(file, motion, _literal(seen @ part.end), auxiliary))
    start = Span(motion.span.start, motion.span.start)
    texts = {start: "".join(f"{line}{end}{indent}" for line in lines)}
    last = parts[-1]
    if isinstance(last, Arc) and motion.auxiliary is not None:
        texts[motion.auxiliary.span] = _literal(seen @ last.poses([0.5])[0])
    return texts


def _line(file: KrlFile, motion: Motion, target: str, auxiliary: str) -> str:
    """The motion's own line with other points. It does not stop there: it is approximated."""
    text, start = file.source(motion.span), motion.span.start
    places = [(motion.target.span, target)] + ([(motion.auxiliary.span, auxiliary)] if motion.auxiliary else [])
    for span, literal in sorted(places, reverse=True):
        text = text[: span.start - start] + literal + text[span.end - start :]
    if motion.approximation or motion.spline:
        return text
    return f"{text} {'C_SPL' if motion.kind.startswith('S') else 'C_DIS'}"


def _surroundings(file: KrlFile, motion: Motion) -> tuple[str, str]:
    """White space before the motion in its line, and the end of line used there."""
    before = file.text[: motion.span.start].rpartition("\n")[2]
    following = file.text[motion.span.end :].partition("\n")
    end = "\r\n" if following[0].endswith("\r") or (not following[1] and "\r\n" in file.text) else "\n"
    return before if not before.strip() else "", end


def _literal(pose: Floats) -> str:
    values = [*pose[:3, 3].tolist(), *abc_from_rotation(pose[:3, :3]).tolist()]
    return aggregate_text(dict(zip(CARTESIAN, values, strict=True)))
