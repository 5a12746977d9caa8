"""URScript programs: new numbers and motions written into their text; everything else stays to the byte."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from cellctl.compensation.paths import Arc
from cellctl.files import InputError, Problem
from cellctl.files.spans import Span
from cellctl.formats.description import plain_number
from cellctl.kinematics import Floats, inverse_pose, rotation_vector
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
from cellctl.operations.programs._urscript_motions import ScriptMotions
from cellctl.operations.programs._urscript_points import PART, POSE, RADIUS, places_of_points
from cellctl.urscript import Call, Evaluation, ScriptFile

_SUFFIX = ".script"
_DECIMALS = 9
"""1e-6 mm; 1e-9 rad of a joint move the TCP of an arm that reaches 2 m by 2e-6 mm."""
_BLEND_SHARE = 0.25
"""Radius at an inserted point, of the shortest part: the two blends of a part do not meet."""


@final
@dataclass(frozen=True)
class ScriptFiles:
    """A program is one file."""

    script: Path

    @classmethod
    def of(cls, script: Path, config: Path | None) -> ScriptFiles:
        """Raises InputError where the file is not there, or where data of the controller are given."""
        if config is not None:
            what = "is for KRL: a URScript program has its tools and features in itself"
            raise InputError(Problem("--config", 0, 0, what, "leave it out"))
        if not script.is_file():
            raise InputError(Problem(str(script), 0, 0, "there is no such file"))
        return cls(script)

    @property
    def main(self) -> Path:
        """The program itself."""
        return self.script

    @property
    def read(self) -> list[Path]:
        """All files that are read."""
        return [self.script]

    def load(self, tool: Numbers | None, base: Numbers | None) -> ScriptProgram:
        """Read the program. tool: stated by a person. Raises OSError, and InputError for a base, or where its blocks
        are not closed.
        """
        if base is not None:
            what = "is for KRL: poses of a URScript program are in the robot's base, or in its features"
            raise InputError(Problem("--base", 0, 0, what, "leave it out"))
        program = ScriptProgram(ScriptMotions(ScriptFile.load(self.script), tool))
        _ = program.moves
        return program

    def outputs(self, out: Path) -> dict[str, Path]:
        """Into the folder `out`, or to the file `out`. Raises InputError where it is neither."""
        if out.is_dir() or is_new_folder(out):
            return {PART: out / self.script.name}
        if out.suffix.lower() != _SUFFIX:
            what = f"{out} is neither a folder nor a {_SUFFIX} file"
            raise InputError(Problem("--out", 0, 0, what, "give one of these"))
        return {PART: out}


@final
@dataclass(frozen=True)
class ScriptProgram:
    """A program that was read: a `Program` of its language."""

    motions: ScriptMotions

    @property
    def name(self) -> str:
        """The name of the file."""
        return self.motions.file.name

    @property
    def names(self) -> dict[str, str]:
        """The name of the file by its part."""
        return {PART: self.name}

    @property
    def moves(self) -> tuple[Move, ...]:
        """All motions of the robot, in the order of the file."""
        return self.motions.moves

    @property
    def own_calibration(self) -> bool:
        """Yes: each arm is calibrated at the factory, and the controller computes poses with that."""
        return True

    @property
    def not_understood(self) -> tuple[Unchanged, ...]:
        """Lines that are not understood, and motions without a point."""
        return self.motions.not_understood

    def several(self, kind: FrameKind) -> list[str]:
        """The tools of the program, where there are several."""
        return self.motions.tools if kind == "tool" else []

    def rewritten(
        self, point: ProgramPoint, values: Mapping[Gives, Floats], turn: int | None
    ) -> tuple[dict[str, str], ProgramPoint]:
        """New numbers as text, and the point with them as they are rounded: see `Program.rewritten`."""
        assert turn is None  # a script states none
        old = self.motions.points[_place(point.key)]
        new = dict[str, float]()
        for gives, value in values.items():
            if gives == "joints":
                new |= {label: float(angle) for label, angle in zip(old.components, np.deg2rad(value), strict=True)}
                continue
            written = np.array([old.components[label].value for label in POSE[3:]])
            pose = dict(zip(POSE, [*(value[:3, 3] / 1000.0), *nearest_vector(value, written)], strict=True))
            labels = {"pose": POSE, "place": POSE[:3], "orientation": POSE[3:]}[gives]
            new |= {label: float(pose[label]) for label in labels}
        texts = {label: plain_number(each / old.components[label].factor, _DECIMALS) for label, each in new.items()}
        rounded = {label: float(text) * old.components[label].factor for label, text in texts.items()}
        return texts, old.read(rounded)

    def texts(self, numbers: Mapping[Hashable, Mapping[str, str]], insertions: Sequence[Insertion]) -> dict[str, bytes]:
        """The content of the file with new numbers and motions in parts."""
        texts = dict[Span, str]()
        for key, components in numbers.items():
            point = self.motions.points[_place(key)]
            texts |= {point.components[label].span: text for label, text in components.items()}
        file = self.motions.file
        for insertion in insertions:
            texts = replacing(texts, _inserted(file, self.motions.statements[insertion.move.place], insertion))
        return {PART: file.replaced(texts)}


def _place(key: Hashable) -> Span:
    assert isinstance(key, Span)
    return key


def nearest_vector(pose: Floats, old: Floats) -> Floats:
    """The rotation vector (3,) of a pose that is nearest to `old`: whole turns about its axis more or less."""
    vector = rotation_vector(pose[:3, :3])
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 1e-9 else old / max(float(np.linalg.norm(old)), 1e-9)
    ways = [vector + turns * 2.0 * np.pi * axis for turns in (-1, 0, 1)]
    return min(ways, key=lambda way: float(np.linalg.norm(way - old)))


def _inserted(file: ScriptFile, statement: Evaluation, insertion: Insertion) -> dict[Span, str]:
    """New lines before the motion; of a circle also a new point on the way in its own line."""
    parts, seen, motion = insertion.parts, inverse_pose(insertion.base), statement.value
    assert isinstance(motion, Call)
    places = list(places_of_points(motion))
    indent, end = surroundings(file.text, statement.span)
    shortest = min(float(np.linalg.norm(part.end[:3, 3] - part.start[:3, 3])) for part in parts)
    radius = plain_number(_BLEND_SHARE * shortest / 1000.0, 5)
    lines = [f"# {insertion.words}"]
    for part in parts[:-1]:
        literals = [_literal(seen @ part.poses([0.5])[0])] if isinstance(part, Arc) else []
        lines.append(_line(file, motion, places, [*literals, _literal(seen @ part.end)], radius))
    start = Span(statement.span.start, statement.span.start)
    texts = {start: "".join(f"{line}{end}{indent}" for line in lines)}
    last = parts[-1]
    if isinstance(last, Arc):
        texts[places[0]] = _literal(seen @ last.poses([0.5])[0])
    return texts


def _line(file: ScriptFile, motion: Call, places: Sequence[Span], literals: Sequence[str], radius: str) -> str:
    """The motion's own call to other points. It does not stop there: it is blended."""
    given = motion.argument(RADIUS[motion.name], "r")
    edits = dict(zip(places, literals, strict=True))
    edits |= {given.span: radius} if given else {Span(motion.span.end - 1, motion.span.end): f", r={radius})"}
    text, start = file.source(motion.span), motion.span.start
    for span, literal in sorted(edits.items(), reverse=True):
        text = text[: span.start - start] + literal + text[span.end - start :]
    return text


def _literal(pose: Floats) -> str:
    values = [*(pose[:3, 3] / 1000.0), *rotation_vector(pose[:3, :3])]
    return f"p[{', '.join(plain_number(float(value), _DECIMALS) for value in values)}]"


URSCRIPT = ProgramLanguage("URScript", (_SUFFIX,), ScriptFiles.of)
