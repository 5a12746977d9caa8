"""The page put together and written: sections of a run, rendered by one template."""

from __future__ import annotations

from pathlib import Path

from cellctl import __version__
from cellctl.files import InputError, write_atomically
from cellctl.report.measured import (
    drift_section,
    held_out_section,
    standoff_section,
    stops_section,
    table_section,
    touches_section,
)
from cellctl.report.model import model_section
from cellctl.report.provenance import provenance
from cellctl.report.run import Run
from cellctl.report.summary import head
from cellctl.report.template import template
from cellctl.report.touches import TouchErrors, touch_errors

FILE_NAME = "report.html"


def write_report(run: Path, target: Path | None = None) -> Path:
    """Write the report of a run (its folder or journal) to `target`, or `report.html` in its folder; where it is.

    Raises JournalError where the journal cannot be read, OSError where the file cannot be written.
    """
    loaded = Run.load(run)
    path = target or loaded.folder / FILE_NAME
    write_atomically(path, render(loaded))
    return path


def report_text(run: Path) -> str:
    """The report of a run (its folder or journal) as HTML. Raises JournalError where the journal cannot be read."""
    return render(Run.load(run))


def render(run: Run) -> str:
    """The report of a loaded run as HTML: no script, nothing fetched, no date but the run's own."""
    errors, complaints = _errors(run)
    return template("report.html").render(
        head=head(run),
        complaints=[*run.complaints, *complaints],
        held_out=held_out_section(run, errors),
        standoff=standoff_section(run),
        touches=touches_section(run, errors),
        stops=stops_section(run),
        drift=drift_section(run),
        model=model_section(run),
        table=table_section(run),
        provenance=provenance(run),
        version=__version__,
    )


def _errors(run: Run) -> tuple[TouchErrors | None, list[str]]:
    """Every touch's errors, where there is a model and its data set; what is wrong with them."""
    if run.model is None or run.data is None:
        return None, []
    try:
        return touch_errors(run.model, run.data, run.artefact), []
    except (InputError, ValueError) as error:
        return None, [f"the touches cannot be computed anew: {error}"]
