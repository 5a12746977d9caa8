"""Builds and writes the page: the sections for which a run has rows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cellctl import __version__
from cellctl.files import InputError, write_atomically
from cellctl.report.budget import Contribution
from cellctl.report.run import Run
from cellctl.report.section import ReportSection, Sections
from cellctl.report.sigmas import FIGURES, Sigma
from cellctl.report.summary import summary
from cellctl.report.template import template, template_of

FILE_NAME = "report.html"


def write_report(run: Path, target: Path | None = None, facts: Mapping[str, Any] | None = None) -> Path:
    """Write the report of a run (its folder or journal) to `target`, or `report.html` in its folder; returns the path.

    facts: fields of `ReportFacts` that replace those of the cell file.

    Raises JournalError if the journal cannot be read, OSError if the file cannot be written.
    """
    loaded = Run.load(run).with_facts(facts or {})
    path = target or loaded.folder / FILE_NAME
    write_atomically(path, render(loaded))
    return path


def report_text(run: Path) -> str:
    """The report of a run (its folder or journal) as HTML. Raises JournalError if the journal cannot be read."""
    return render(Run.load(run))


def render(run: Run, sections: Sections | None = None) -> str:
    """The report of a loaded run as HTML: no script, nothing fetched, no date but the run's own.

    sections: by default the installed ones. A failed section is named, and the others are shown.
    """
    found = sections or Sections.installed()
    complaints = [*run.complaints, *found.broken]
    shown: list[Mapping[str, str]] = []
    lines: list[Mapping[str, Any]] = []
    environment: dict[str, str] = {}
    contributions: list[Contribution] = []
    sigmas: list[Sigma] = []
    for section in found.usable:
        try:
            text = _text(section, run)
            if text is None:
                continue
            added = list(section.error_lines(run)), section.environment(run), list(section.contributions(run))
        except InputError as error:
            complaints += [f"section '{section.id}': {problem}" for problem in error.problems]
        except Exception as error:  # the code of another package may raise anything
            complaints.append(f"section '{section.id}' cannot be shown: {type(error).__name__}: {error}")
        else:
            lines += added[0]
            environment |= added[1]
            contributions += added[2]
            shown.append({"id": section.id, "title": section.title, "text": text})
            sigmas += section.sigmas
    return template("report.html").render(
        run=run,
        complaints=list(dict.fromkeys(complaints)),
        lines=lines,
        s=summary(run, environment, contributions),
        sections=shown,
        sigmas=[*(FIGURES if lines else ()), *dict.fromkeys(sigmas)],
        version=__version__,
    )


def _text(section: ReportSection, run: Run) -> str | None:
    """The section as HTML; None if the run has no data for it."""
    data = section.build(run) if section.serves(run) else None
    return None if data is None else template_of(section.template).render(data)
