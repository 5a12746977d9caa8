"""`cellctl show`, `report`, `export`, `replay`: what is done with recorded runs, from their folders alone."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, final

import typer
from pydantic import ValidationError

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, write_json
from cellctl.devices.cell import ReportFacts
from cellctl.files import InputError, Problem, write_atomically
from cellctl.journal import JournalCheck, RunState, check_journal, fold, journal_in, read_journal, run_place
from cellctl.operations import export as exports
from cellctl.operations.comparing_models import ModelDifference, ParameterChange
from cellctl.operations.comparing_runs import ComparedFigure, RunComparison, compare_runs
from cellctl.operations.replay import Agreement, ArtefactReplay, FolderFile, Replay, StepReplay, replay_run
from cellctl.operations.results import as_json
from cellctl.operations.run_indexing import tell_existing_index
from cellctl.operations.run_list import RunSummary, run_summary
from cellctl.report import FILE_NAME, write_report
from cellctl.report.figures import acceptance_words, agreement_lines, fixed, with_sigma


def show(
    run: arguments.Run,
    folder: arguments.Runs = Path("runs"),
    events: Annotated[bool, typer.Option(help="Show every event.")] = False,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify", help="Compare each event with its digest: was the journal changed since? Exit code 1: it was."
        ),
    ] = False,
    against: Annotated[
        Path | None, typer.Option(help="Another run: show both side by side, with the difference of their models.")
    ] = None,
    json_: arguments.Json = None,
) -> None:
    """Show one run: devices, steps, verdict; or compare it with another.

    Example: cellctl show sphere_selfcal-20261121T192433Z --events
    """
    place = run_place(run, folder)
    refuse_outputs({"--json": json_}, [place, *place.glob("*")])
    if against is not None:
        _compare(place, run_place(against, folder), json_)
        return
    entries = list(read_journal(place))
    state = fold(entries)
    summary = run_summary(place, state)
    check = check_journal(place) if verify else None
    write_json(as_json(summary) | ({"journal": as_json(check)} if check else {}), json_)
    if json_ != "-":
        for line in (*_run_lines(summary, state), *_check_lines(check)):
            typer.echo(line)
        for entry in entries if events else ():
            typer.echo(f"{entry.seq:6d} {entry.time_ns * 1e-9:12.3f} s  {entry.event}")
    raise typer.Exit(1 if check and check.changed else 0)


def _check_lines(check: JournalCheck | None) -> Iterator[str]:
    if check is None:
        return
    if check.without == check.events:
        yield "  journal    has no digests (an older cellctl wrote it): whether it was changed is not known"
    elif not check.changed:
        yield f"  journal    {check.events} events as they were written; digest of the last: {check.digest or 'none'}"
        if check.without:
            yield f"             the last {check.without} of them have no digest (an older cellctl wrote them)"
    else:
        yield f"  journal    changed after the run: {'; '.join(check.changed)}"


def _compare(a: Path, b: Path, json_: str | None) -> None:
    found = compare_runs(a, b)
    write_json(as_json(found), json_)
    if json_ != "-":
        for line in compared_words(found):
            typer.echo(line)


def _run_lines(summary: RunSummary, state: RunState) -> list[str]:
    lines = [
        f"{summary.run}: {summary.state}",
        f"  procedure  {summary.procedure}",
        f"  cell       {summary.cell} ({summary.clock}, seed {summary.seed})",
        f"  began      {summary.began}, {summary.cell_s:.1f} s of the cell's time",
    ]
    if summary.process:
        lines.append(f"  run by     process {summary.process}")
    lines += [
        f"  {name:10} {identity['model']}, serial {identity['serial']}" for name, identity in state.identities.items()
    ]
    attempts = f"attempts at steps: {summary.attempts} in {len(state.steps)} steps"
    lines.append(f"  points     {summary.points} measured; {attempts}")
    if summary.verdict:
        lines.append(f"  verdict    {summary.verdict}: {summary.sentence}")
    if summary.acceptance:
        lines.append(f"  acceptance {acceptance_words(summary.acceptance)}")
    if summary.table_words:
        lines.append(f"  table      {summary.table_words}")
    lines += [f"  {line}" for line in summary.lines]
    if summary.problem:
        lines += [f"  ended by   {summary.problem}", f"  cure       {summary.cure}"]
    return lines


def report(
    run: arguments.Run,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", "--output", help="Output file. Default: report.html in the run folder."),
    ] = None,
    customer: Annotated[str | None, typer.Option(help="Customer, in place of the cell file's.")] = None,
    site: Annotated[str | None, typer.Option(help="Site, in place of the cell file's.")] = None,
    order: Annotated[str | None, typer.Option(help="Order, in place of the cell file's.")] = None,
    operator: Annotated[str | None, typer.Option(help="Operator, in place of the recorded name.")] = None,
    limit: Annotated[
        float | None, typer.Option(help="Acceptance limit of an error, mm, in place of the cell file's.")
    ] = None,
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Write the calibration report of a run again, as HTML that prints on A4.

    Made from the journal, data set, model and table in the run folder. Two pages hold what a manager needs: parties,
    robot, instruments, environment, verdict, acceptance and uncertainty budget. The rest is for a metrologist.

    Example: cellctl report sphere_selfcal-20261121T192433Z --customer ACME --limit 0.2 -o report.html
    """
    place = run_place(run, runs)
    refuse_outputs(
        {"--out": out, "--json": json_}, [place, *(file for file in place.glob("*") if file.name != FILE_NAME)]
    )
    if limit is not None and not 0.0 < limit < float("inf"):
        raise typer.BadParameter("--limit is a length in mm, above 0")
    stated = {"customer": customer, "site": site, "order": order, "operator": operator, "limit_mm": limit}
    written = write_report(place, out, {name: value for name, value in stated.items() if value is not None})
    if out is None:
        tell_existing_index(journal_in(place).parent)
    if json_ != "-":
        typer.echo(written)
    write_json({"run": place.name, "file": str(written)}, json_)


@final
class Form(StrEnum):
    """The forms of an export, as the help lists them without loading the exports."""

    CSV = "csv"
    PARQUET = "parquet"
    JSONL = "jsonl"
    BLUESKY = "bluesky"
    FIGURES = "figures"
    DCC = "dcc"
    ZIP = "zip"


def export(
    run: arguments.Run,
    as_: Annotated[
        Form,
        typer.Option(
            "--as",
            help="csv, parquet: samples. jsonl: events. bluesky: event-model documents. figures: every picture of the "
            "report as SVG and PNG, in a zip. dcc: Digital Calibration Certificate (PTB's XML). zip: everything.",
        ),
    ] = Form.ZIP,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Output file. Default: RUN-samples.csv, RUN-run.zip … in this folder."),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="For dcc: NAME=TEXT in place of the cell file's `report:`, as laboratory=ACME."),
    ] = None,
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Export a run: its samples as CSV or Parquet, its events as JSON lines or bluesky documents, the pictures of its
    report as SVG and PNG, a Digital Calibration Certificate, or all in one zip.

    The run may be running, aborted or damaged: what can be read is exported, the rest is named (exit code 2).

    Example: cellctl export sphere_selfcal-20261121T192433Z --as csv -o samples.csv
    """
    place, form = run_place(run, runs), exports.Form(as_.value)
    folder = journal_in(place).parent
    target = out or Path(f"{folder.resolve().name}-{form.file_name}")
    refuse_outputs({"--out": target, "--json": json_}, [place, *folder.glob("*")])
    found = exports.export_run(place, form, _facts(set_ or []))
    write_atomically(target, found.content)
    counts = {"samples": found.samples, "events": found.events}
    result = {"run": folder.resolve().name, "form": form.value, "file": str(target), **counts}
    write_json({**result, "missing": list(found.missing)}, json_)
    if json_ != "-":
        typer.echo(f"{target}: {found.samples} samples, {found.events} events")
    found.refuse_missing(place, target)


def _facts(words: list[str]) -> dict[str, str]:
    """NAME=TEXT of the texts of `report:`, checked as those of a cell file."""
    pairs = {name: text for name, _, text in (each.partition("=") for each in words)}
    texts = {name for name, each in ReportFacts.model_fields.items() if each.default == ""}
    if wrong := pairs.keys() - texts:
        raise typer.BadParameter(f"--set {', '.join(sorted(wrong))}: no text of `report:`; {', '.join(sorted(texts))}")
    try:
        return ReportFacts.model_validate(pairs).model_dump(include=set(pairs))
    except ValidationError as error:
        raise typer.BadParameter(f"--set {error.errors()[0]['loc'][0]}: {error.errors()[0]['msg']}") from None


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
    place = run_place(run, runs)
    refuse_outputs({"--json": json_}, [place, *place.glob("*")])
    _refuse_folder(out, place)
    found = replay_run(place, lambda step: typer.echo(f"computing {step} …", err=True))
    if out:
        _write(found, out)
    write_json(as_json(found), json_)
    if json_ != "-":
        for line in _replay_lines(found):
            typer.echo(line)
    raise typer.Exit(1 if found.agreement is Agreement.DIFFERENT else 0)


def _refuse_folder(out: Path | None, run: Path) -> None:
    """Raise InputError if the replayed files would replace those of the run, or the folder cannot exist."""
    if out is None:
        return
    if out.exists() and not out.is_dir():
        raise InputError(Problem(str(out), 0, 0, "is no folder", "give a folder with --out"))
    folder = run if run.is_dir() else run.parent
    if out.resolve() == folder.resolve():
        what = "is the run folder: its files would be written over"
        raise InputError(Problem(str(out), 0, 0, what, "give another folder with --out"))


def _write(found: Replay, out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    for name, content in found.contents.items():
        write_atomically(out / name, content)


def _replay_lines(found: Replay) -> list[str]:
    lines = [f"{found.run}: {len(found.steps)} computing steps, computed again from the journal"]
    lines += [f"  changed since the run: {text}" for text in found.changed]
    lines += [f"  the journal was changed after the run: {text}" for text in found.edited]
    width = max((len(name) for name in (*(a.name for a in found.artefacts), *(s.step for s in found.steps))), default=0)
    lines += [line for each in found.artefacts for line in _artefact_lines(each, width)]
    lines += [line for each in found.steps for line in _step_lines(each, width)]
    whole = {
        Agreement.EXACT: "equal",
        Agreement.WITHIN_TOLERANCE: f"{found.agreement}: {found.tolerance}",
        Agreement.DIFFERENT: "not equal: see above",
    }[found.agreement]
    return [*lines, f"Data set, model, table and results: {whole}." if found.steps else "There is nothing to compare."]


def _artefact_lines(each: ArtefactReplay, width: int) -> list[str]:
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


_MOST_PARAMETERS = 12
"""Maximum number of parameters shown, those with the largest differences; `--json` has all."""


def compared_words(found: RunComparison) -> Iterator[str]:
    """The comparison, line by line; facts that are the same are shown once."""
    yield f"a: {found.a}"
    yield f"b: {found.b}"
    for fact in found.facts:
        yield f"  {fact.name:16} {fact.a}" + ("" if fact.same else f"  →  {fact.b}")
    yield from (f"  {note}" for note in found.notes)
    for figure in found.figures:
        yield f"  {figure.name:16} {fixed(figure.a)} → {fixed(figure.b)} mm{_difference(figure)}"
    if found.models is None:
        yield f"  No parameters are compared: {found.why_not}."
        return
    yield from _of_agreement(found)
    yield from _of_models(found.models)


def _of_agreement(found: RunComparison) -> Iterator[str]:
    if found.agreement is None:
        yield f"  Whether the calibrations agree is not judged: {found.no_agreement}."
        return
    yield f"  {found.agreement.sentence}"
    yield from (f"  {words}" for words in agreement_lines(found.agreement))


def _of_models(models: ModelDifference) -> Iterator[str]:
    yield f"  {models.sentence}"
    if models.tcp_rms_mm is not None:
        yield (
            f"  TCPs of the two models: {fixed(models.tcp_rms_mm)} mm apart (RMS; max {fixed(models.tcp_max_mm)}), "
            f"with base and tool registered; σ explains {fixed(models.tcp_sigma_mm)} mm."
        )
    yield from (f"  Not compared: {each}." for each in models.left_out)
    for change in models.parameters[:_MOST_PARAMETERS]:
        yield f"    {change.label:12} {fixed(change.a, 4)} → {fixed(change.b, 4)} {change.unit}{_difference(change)}"
    if len(models.parameters) > _MOST_PARAMETERS:
        yield f"    and {len(models.parameters) - _MOST_PARAMETERS} parameters with smaller differences: --json has all"


def _difference(each: ComparedFigure | ParameterChange) -> str:
    if each.difference is None:
        return ""
    if each.sigma is None:
        return f", {fixed(each.difference, 4)} (σ not known)"
    return f", {with_sigma(each.difference, each.sigma)}{', significant' if each.significant else ''}"
