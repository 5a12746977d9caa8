"""`cellctl replay`: repeats a run's computations from its journal and compares them with the record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.operations.replay import ArtefactReplay, Replay, StepReplay

_SHOWN = 5
"""Maximum number of differences shown for a step; `--json` has all."""

_SHORT = 12
"""Number of characters shown of a hash."""


def replay(
    run: arguments.Run,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Write the files that were computed again into this folder.")
    ] = None,
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Compute a run's data set, model and table again from its journal alone; say what differs, and why.

    Another processor or library changes the last digits: that is stated, and is no failure.

    Example: cellctl replay sphere_selfcal-20261121T192433Z -o again
    """
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.journal import run_place
    from cellctl.operations.replay import Agreement, replay_run

    place = run_place(run, runs)
    refuse_outputs({"--json": json_}, [place, *place.glob("*")])
    _refuse_folder(out, place)
    found = replay_run(place, lambda step: typer.echo(f"computing {step} …", err=True))
    if out:
        _write(found, out)
    write_json(found.to_json(), json_)
    if json_ != "-":
        for line in _lines(found):
            typer.echo(line)
    raise typer.Exit(1 if found.agreement is Agreement.DIFFERENT else 0)


def _refuse_folder(out: Path | None, run: Path) -> None:
    """Raise InputError if the replayed files would replace those of the run, or the folder cannot exist."""
    from cellctl.files import InputError, Problem

    if out is None:
        return
    if out.exists() and not out.is_dir():
        raise InputError(Problem(str(out), 0, 0, "is no folder", "give a folder with --out"))
    folder = run if run.is_dir() else run.parent
    if out.resolve() == folder.resolve():
        what = "is the run folder: its files would be written over"
        raise InputError(Problem(str(out), 0, 0, what, "give another folder with --out"))


def _write(found: Replay, out: Path) -> None:
    from cellctl.files import write_atomically

    out.mkdir(parents=True, exist_ok=True)
    for name, content in found.contents.items():
        write_atomically(out / name, content)


def _lines(found: Replay) -> list[str]:
    from cellctl.operations.replay import TOLERANCE, Agreement

    lines = [f"{found.run}: {len(found.steps)} computing steps, computed again from the journal"]
    lines += [f"  changed since the run: {text}" for text in found.changed]
    width = max((len(name) for name in (*(a.name for a in found.artefacts), *(s.step for s in found.steps))), default=0)
    lines += [line for each in found.artefacts for line in _artefact_lines(each, width)]
    lines += [line for each in found.steps for line in _step_lines(each, width)]
    whole = {
        Agreement.EXACT: "equal",
        Agreement.WITHIN_TOLERANCE: f"{found.agreement}: {TOLERANCE}",
        Agreement.DIFFERENT: "not equal: see above",
    }[found.agreement]
    return [*lines, f"Data set, model, table and results: {whole}." if found.steps else "There is nothing to compare."]


def _artefact_lines(each: ArtefactReplay, width: int) -> list[str]:
    from cellctl.operations.replay import Agreement, FolderFile

    if each.agreement is Agreement.WITHIN_TOLERANCE:
        return [f"{each.name:{width}}  equal within the tolerance"]
    if not each.replayed_equal:
        text = f"differs: {_hash(each.recorded)} → {_hash(each.replayed)}"
    elif each.folder is FolderFile.CHANGED:
        text = f"equal to the journal ({_hash(each.recorded)}), but not to the file in the run folder"
    else:
        text = f"equal ({_hash(each.recorded)})"
    if each.folder is FolderFile.MISSING:
        text += "; not in the run folder"
    if each.folder is FolderFile.REPLACED:
        text += f"; of {each.step}, attempt {each.attempt}, and written again later"
    return [f"{each.name:{width}}  {text}", *_details([str(each.first)] if each.first else [], each.why)]


def _step_lines(each: StepReplay, width: int) -> list[str]:
    from cellctl.operations.replay import Agreement

    rows = f" and {each.rows} row{'s' * (each.rows > 1)}" if each.rows else ""
    attempt = f", attempt {each.attempt}" if each.attempt > 1 else ""
    if each.agreement is not Agreement.DIFFERENT:
        within = " within the tolerance" * (each.agreement is Agreement.WITHIN_TOLERANCE)
        return [f"{each.step:{width}}  result{rows} equal{within}{attempt}"]
    more = len(each.differences) - _SHOWN
    shown = [*each.differences[:_SHOWN], *([f"and {more} more differences"] if more > 0 else [])]
    return [f"{each.step:{width}}  result{rows} differ{'s' * (not each.rows)}{attempt}:", *_details(shown, each.why)]


def _details(differences: list[str], why: tuple[str, ...]) -> list[str]:
    return [*(f"    {text}" for text in differences), *(f"    why: {text}" for text in why)]


def _hash(sha256: str | None) -> str:
    return f"sha256 {sha256[:_SHORT]}" if sha256 else "not made"
