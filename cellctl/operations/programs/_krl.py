"""KRL programs: their files, and new numbers and motions written into their text; everything else stays to the byte."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import final

import numpy as np

from cellctl.compensation.paths import Arc
from cellctl.files import InputError, Problem
from cellctl.kinematics import Floats, abc_from_rotation, inverse_pose
from cellctl.krl import CARTESIAN, KrlFile, Motion, Point, Span
from cellctl.krl.writing import aggregate_text, number_text
from cellctl.operations.programs._krl_motions import KrlMotions, Part, point_read
from cellctl.operations.programs._language import (
    FrameKind,
    Gives,
    Insertion,
    Move,
    Numbers,
    ProgramLanguage,
    ProgramPoint,
    Unchanged,
    is_new_folder,
    replacing,
    surroundings,
)


@final
@dataclass(frozen=True)
class KrlFiles:
    """src: the program. dat: its data list, None where there is none beside it. config: None where it is not given."""

    src: Path
    dat: Path | None
    config: Path | None

    @classmethod
    def of(cls, src: Path, config: Path | None) -> KrlFiles:
        """The data list is the file beside `src` with the same name and the suffix .dat, in any case. Raises InputError
        where `src` is not a program, or a file is not there.
        """
        if src.suffix.lower() != ".src":
            raise InputError(Problem(str(src), 0, 0, "is not a KRL program", "give the .src; its .dat is read too"))
        missing = [path for path in (src, config) if path is not None and not path.is_file()]
        if missing:
            raise InputError(Problem(str(path), 0, 0, "there is no such file") for path in missing)
        wanted = f"{src.stem}.dat".lower()
        beside = sorted(path for path in src.parent.iterdir() if path.name.lower() == wanted and path.is_file())
        if len(beside) > 1:
            names = ", ".join(path.name for path in beside)
            raise InputError(Problem(str(src), 0, 0, f"has several data lists: {names}", "leave one"))
        return cls(src, beside[0] if beside else None, config)

    @property
    def main(self) -> Path:
        """The program itself."""
        return self.src

    @property
    def read(self) -> list[Path]:
        """All files that are read."""
        return [path for path in (self.src, self.dat, self.config) if path]

    def load(self, tool: Numbers | None, base: Numbers | None) -> KrlProgram:
        """Read the program. tool, base: stated by a person. Raises OSError."""
        src, dat, config = (KrlFile.load(path) if path else None for path in (self.src, self.dat, self.config))
        assert src is not None
        return KrlProgram(KrlMotions(src, dat, config, tool, base))

    def outputs(self, out: Path) -> dict[str, Path]:
        """Where the changed files go, by part: into the folder `out`, or to the program `out` and its data list.

        A folder need not be there yet (`is_new_folder`). Raises InputError where `out` is neither.
        """
        if out.is_dir() or is_new_folder(out):
            paths = {"src": out / self.src.name, "dat": out / (self.dat or self.src).name}
        elif out.suffix.lower() == ".src":
            paths = {"src": out, "dat": out.with_suffix(self.dat.suffix if self.dat else ".dat")}
        else:
            raise InputError(Problem("--out", 0, 0, f"{out} is neither a folder nor a .src file", "give one of these"))
        return paths if self.dat else {"src": paths["src"]}


_LABELS: dict[Gives, tuple[str, ...]] = {"pose": CARTESIAN, "place": CARTESIAN[:3], "orientation": CARTESIAN[3:]}


@final
@dataclass(frozen=True)
class KrlProgram:
    """A program that was read: a `Program` of its language."""

    read: KrlMotions

    @property
    def name(self) -> str:
        """The name of the `.src`."""
        return self.read.src.name

    @property
    def names(self) -> dict[str, str]:
        """The name of each file by its part, `src` first."""
        return {part: file.name for part, file in self.read.parts.items()}

    @property
    def moves(self) -> tuple[Move, ...]:
        """All motions of the robot, in the order of the file."""
        return self.read.moves

    @property
    def own_calibration(self) -> bool:
        """No: the controller has its maker's lengths, and its calibration is of the joints' zeros."""
        return False

    @property
    def not_understood(self) -> Iterator[Unchanged]:
        """Lines that are not understood."""
        for part, file in self.read.parts.items():
            for unknown in file.unknown:
                yield Unchanged(part, unknown.line, "", f"not understood: {unknown.reason}")

    def several(self, kind: FrameKind) -> list[str]:
        """The tools or bases of the program's motions, where there are several."""
        return self.read.several(kind)

    def rewritten(
        self, point: ProgramPoint, values: Mapping[Gives, Floats], turn: int | None
    ) -> tuple[dict[str, str], ProgramPoint]:
        """New components as text, and the point with them as they are rounded: see `Program.rewritten`."""
        part, old = self._points[point.key]
        new = dict[str, float]()
        for gives, value in values.items():
            new |= _components(old, gives, value)
        texts = {label: number_text(number) for label, number in new.items()}
        if turn is not None:
            texts["T"] = str(turn)
        return texts, point_read(part, old, {label: float(text) for label, text in texts.items()})

    def texts(self, numbers: Mapping[Hashable, Mapping[str, str]], insertions: Sequence[Insertion]) -> dict[str, bytes]:
        """The content of each file with new numbers and motions in parts."""
        texts: dict[Part, dict[Span, str]] = {part: {} for part in self.read.parts}
        for key, components in numbers.items():
            part, point = self._points[key]
            texts[part] |= {point.numbers[label].span: text for label, text in components.items()}
        for insertion in insertions:
            texts["src"] = replacing(
                texts["src"], _inserted(self.read.src, self._motions[insertion.move.place], insertion)
            )
        return {part: file.replaced(texts[part]) for part, file in self.read.parts.items()}

    @cached_property
    def _points(self) -> dict[Hashable, tuple[Part, Point]]:
        """File and numbers of each point, by its key."""
        return {(part, point.span): (part, point) for part, file in self.read.parts.items() for point in file.points}

    @cached_property
    def _motions(self) -> dict[int, Motion]:
        return {motion.span.start: motion for motion in self.read.src.of(Motion)}


def _components(point: Point, gives: Gives, value: Floats) -> dict[str, float]:
    """Components of a point by their labels: joint readings, or a pose (4, 4) or a part of it."""
    if gives == "joints":
        return {f"A{axis}": reading for axis, reading in enumerate(value.tolist(), 1)}
    angles = _nearest_abc(abc_from_rotation(value[:3, :3]), np.array([point.values[label] for label in "ABC"]))
    new = dict(zip(CARTESIAN, [*value[:3, 3], *angles], strict=True))
    return {label: new[label] for label in _LABELS[gives]}


def _nearest_abc(angles: Floats, old: Floats) -> Floats:
    """The same orientation by the angles A, B, C (3,), deg, nearest to `old`, each within ±180°."""
    ways = np.stack([angles, angles * [1, -1, 1] + 180.0])
    ways = (ways + 180.0) % 360.0 - 180.0
    away = np.abs((ways - old + 180.0) % 360.0 - 180.0).sum(axis=1)
    return np.asarray(ways[np.argmin(away)])


def _inserted(file: KrlFile, motion: Motion, insertion: Insertion) -> dict[Span, str]:
    """New lines before the motion; of a circle also a new auxiliary point in its own line."""
    parts, seen = insertion.parts, inverse_pose(insertion.base)
    indent, end = surroundings(file.text, motion.span)
    lines = [f"; {insertion.words}"]
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


def _literal(pose: Floats) -> str:
    values = [*pose[:3, 3].tolist(), *abc_from_rotation(pose[:3, :3]).tolist()]
    return aggregate_text(dict(zip(CARTESIAN, values, strict=True)))


KRL = ProgramLanguage("KRL", (".src", ".sub", ".dat"), KrlFiles.of)
