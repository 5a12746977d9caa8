"""Compensated KRL programs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, final

from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import ModelFile
from cellctl.operations.program_compensation import (
    CompensatedFiles,
    ProgramFiles,
    ProgramOptions,
    compensate_files,
    is_new_folder,
    refuse_method,
)


@final
@dataclass(frozen=True, eq=False, repr=False)
class CompensatedProgram:
    """A KRL program with compensated points (docs/programs.md).

    report: the JSON of `cellctl compensate program.src`: compensated `points`, places `left` as they were (file,
    line, reason), corrections, predicted errors, `paths` between the points; `files` is empty.
    """

    files: ProgramFiles
    report: Mapping[str, Any]
    _found: CompensatedFiles

    @classmethod
    def of(
        cls,
        model: ModelFile,
        name: str,
        program: Path,
        method: str,
        cell: str | Path | None,
        options: ProgramOptions,
    ) -> Self:
        """See `Model.compensate_program`."""
        from cellctl.operations.compensating import CellRobot
        from cellctl.operations.shipped import shipped_file

        refuse_method(method)
        files = ProgramFiles.of(program, options.config)
        place = CellRobot.load(shipped_file("cell", Path(cell))) if cell is not None else None
        found = compensate_files(model, name, files, method, options, place)
        return cls(files, found.figures([]), found)

    @property
    def counts(self) -> str:
        """How many points are compensated, and how many places are not."""
        made, left = self.report["compensated"], len(self.report["left"])
        points, places = "point" if made == 1 else "points", "place" if left == 1 else "places"
        return f"{self.files.src.name}: {made} {points} compensated, {left} {places} left unchanged"

    @property
    def texts(self) -> dict[str, bytes]:
        """The changed files: `src`, and `dat` where the program has a data list."""
        return {part: text for part, text in self._found.texts().items() if part in ("src", "dat")}

    def save(self, out: str | Path) -> list[Path]:
        """Write the changed files into a folder, or as a `.src` with its data list; returns their paths.

        Raises InputError where that would replace the program itself. Raises OSError.
        """
        paths = self.files.outputs(Path(out))
        read = {os.path.realpath(path) for path in self.files.read}
        problems = [
            Problem(str(path), 0, 0, "is read here: it would be written over", "give another folder or file")
            for path in paths.values()
            if os.path.realpath(path) in read
        ]
        if problems:
            raise InputError(problems)
        texts = self.texts
        if is_new_folder(Path(out)):
            Path(out).mkdir()
        for part, path in paths.items():
            write_atomically(path, texts[part])
        return list(paths.values())

    def __repr__(self) -> str:
        return f"<cellctl program {self.counts}>"

    def _repr_html_(self) -> str:
        from cellctl.facade.views import program_view

        return program_view(self)


def frame_text(frame: str | Sequence[float] | None) -> str | None:
    """X, Y, Z, A, B, C as on the command line."""
    return frame if frame is None or isinstance(frame, str) else ",".join(repr(float(value)) for value in frame)
