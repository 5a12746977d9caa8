"""`cellctl compensate MODEL program.src`: the same program with compensated points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from cellctl.operations.program_compensation import ProgramOptions


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
    from cellctl.cli.program_words import words_of
    from cellctl.files import write_atomically
    from cellctl.formats import ModelFile
    from cellctl.operations.compensating import CellRobot
    from cellctl.operations.program_compensation import compensate_files, refuse_method
    from cellctl.operations.program_files import ProgramFiles

    refuse_method(method)
    files = ProgramFiles.of(program, options.config)
    outputs = files.outputs(out) if out else {}
    read = [model, cell, *files.read]
    refuse_outputs({**{f"--out ({part})": path for part, path in outputs.items()}, "--json": json_}, read)
    place = CellRobot.load(cell) if cell else None
    found = compensate_files(ModelFile.load(model), str(model), files, method, options, place)
    texts = found.texts()
    for part, path in outputs.items():
        write_atomically(path, texts["src" if part == "src" else "dat"])
    figures = found.figures(list(outputs.values()))
    if json_ != "-":
        for line in words_of(found.program, found.paths, figures):
            typer.echo(line)
    write_json(figures, json_)
