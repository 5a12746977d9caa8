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
    """Compensate the points of `program` and write it to `out`. Raises InputError, also if no point can be changed;
    ends with code 1 if some cannot.
    """
    from cellctl.cli.ends import Exit
    from cellctl.cli.outputs import refuse_outputs, refused_rows, write_json
    from cellctl.cli.program_words import words_of
    from cellctl.files import write_atomically
    from cellctl.formats import ModelFile
    from cellctl.operations.compensating import CellRobot
    from cellctl.operations.program_compensation import ProgramFiles, compensate_files, is_new_folder, refuse_method

    refuse_method(method)
    files = ProgramFiles.of(program, options.config)
    outputs = files.outputs(out) if out else {}
    new = out if out and is_new_folder(out) else None
    written = {} if new else {f"--out ({part})": path for part, path in outputs.items()}
    refuse_outputs({**written, "--json": json_}, [model, cell, *files.read])
    place = CellRobot.load(cell) if cell else None
    identified = ModelFile.load(model)
    with refused_rows(json_):
        found = compensate_files(identified, str(model), files, method, options, place)
    texts = found.texts()
    if new:
        new.mkdir(exist_ok=True)
    for part, path in outputs.items():
        write_atomically(path, texts["src" if part == "src" else "dat"])
    figures = found.figures(list(outputs.values()))
    if json_ != "-":
        for line in words_of(found.program, found.paths, figures):
            typer.echo(line)
    write_json(figures, json_)
    if left := len(found.program.left):
        what = "1 place is not compensated: it stays" if left == 1 else f"{left} places are not compensated: they stay"
        typer.echo(f"cellctl: {program}: {what} as in the program", err=True)
        raise typer.Exit(Exit.NOT_BETTER)
