"""Builds and writes the page of a run: templates, and the sections found by entry points for which it has rows."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Self, final

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from cellctl.devices.commissioning_record import CellRecord
from cellctl.files import InputError, write_atomically
from cellctl.installed import contributions
from cellctl.records import Row
from cellctl.report._run import Run
from cellctl.report._summary import budget_of, environment_of, summary
from cellctl.report.acceptance import Acceptance, acceptance
from cellctl.report.budget import FIGURES, Budget, Contribution, Sigma
from cellctl.report.drawing import Picture, collected_pictures
from cellctl.version import __version__


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("cellctl.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def template(name: str) -> Template:
    """A page template by its file name: inserted values are escaped, and an undefined name is an error."""
    return _environment().get_template(name)


def template_of(text: str) -> Template:
    """A template from its text; it may include and import the files of this package."""
    return _environment().from_string(text)


GROUP = "cellctl.report_sections"
"""The entry point group: name = the section's id, value = a `ReportSection`."""


@final
@dataclass(frozen=True, kw_only=True)
class ReportSection:
    """A section of the report.

    id: unique. title: its heading; "" for none. order: sections are shown in ascending order. needs: row classes; the
    section is left out if the run lacks rows of one of them. build: from the run, the template's data; None
    if there is nothing to show. template: Jinja text; it may include and import the templates of `cellctl.report`.
    error_lines: lines for the table of errors at the top (`cellctl.report.figures.error_line`). environment: name and
    text of each recorded condition. contributions: to the uncertainty budget, of what the section knows. errors: the
    measured errors, mm, whose figures are the verdict's `after`, if the section has them.
    sigmas: each σ that the section shows.
    """

    id: str
    title: str
    order: int
    build: Callable[[Run], Mapping[str, Any] | None]
    template: str
    needs: tuple[type[Row], ...] = ()
    error_lines: Callable[[Run], Sequence[Mapping[str, Any]]] = field(default=lambda _: ())
    environment: Callable[[Run], Mapping[str, str]] = field(default=lambda _: {})
    contributions: Callable[[Run], Sequence[Contribution]] = field(default=lambda _: ())
    errors: Callable[[Run], Sequence[float]] = field(default=lambda _: ())
    sigmas: tuple[Sigma, ...] = ()

    def serves(self, run: Run) -> bool:
        """Whether the run has rows of every class that the section needs. Raises InputError for a damaged row."""
        return all(run.state.recorded(kind) for kind in self.needs)


@final
@dataclass(frozen=True)
class Sections:
    """The sections in their order. broken: those that cannot be loaded, as text."""

    usable: tuple[ReportSection, ...]
    broken: tuple[str, ...] = ()

    @classmethod
    def of(cls, sections: Iterable[ReportSection], broken: Sequence[str] = ()) -> Self:
        """These sections, sorted."""
        return cls(tuple(sorted(sections, key=lambda each: (each.order, each.id))), tuple(broken))

    @classmethod
    def installed(cls) -> Self:
        """All sections of the installed packages."""
        found: dict[str, ReportSection] = {}
        broken: list[str] = []
        for label, section in contributions(GROUP, ReportSection, "section", broken):
            if found.setdefault(section.id, section) is not section:
                broken.append(f"{label}: there is another section '{section.id}'")
        return cls.of(found.values(), broken)


def template_text(package: str, name: str) -> str:
    """The text of the template file `name` beside the module of a package."""
    return (files(package) / name).read_text(encoding="utf-8")


FILE_NAME = "report.html"
ACCEPTANCE_NAME = "acceptance.json"


def write_report(run: Path, target: Path | None = None, facts: Mapping[str, Any] | None = None) -> Path:
    """Write the report of a run (its folder or journal) to `target`, or `report.html` in its folder; returns the path.

    facts: fields of `ReportFacts` that replace those of the cell file. With the report in the folder goes the decision
    on the run's limit, which the lists of runs show, if a limit is stated.

    Raises JournalError if the journal cannot be read, OSError if a file cannot be written.
    """
    loaded = Run.load(run).with_facts(facts or {})
    path = target or loaded.folder / FILE_NAME
    text, accepted = _rendered(loaded, Sections.installed())
    write_atomically(path, text)
    if target is None and loaded.criterion is not None:
        content = {**accepted.to_json(), "last_event": loaded.state.last_seq}
        write_atomically(loaded.folder / ACCEPTANCE_NAME, f"{json.dumps(content, indent=2)}\n")
    return path


def report_text(run: Path) -> str:
    """The report of a run (its folder or journal) as HTML. Raises JournalError if the journal cannot be read."""
    return render(Run.load(run))


def report_pictures(run: Path) -> list[Picture]:
    """The pictures of the report of a run (its folder or journal), in their order, as the report draws them.

    Raises JournalError if the journal cannot be read.
    """
    with collected_pictures() as found:
        render(Run.load(run))
    return found


def render(run: Run, sections: Sections | None = None) -> str:
    """The report of a loaded run as HTML: no script, nothing fetched, no date but the run's own.

    sections: by default the installed ones. A failed section is named, and the others are shown.
    """
    return _rendered(run, sections or Sections.installed())[0]


def _rendered(run: Run, found: Sections) -> tuple[str, Acceptance]:
    complaints = [*run.complaints, *found.broken]
    shown: list[Mapping[str, str]] = []
    lines: list[Mapping[str, Any]] = []
    sigmas: list[Sigma] = []
    for section in found.usable:
        try:
            text = _text(section, run)
            if text is None:
                continue
            added = section.error_lines(run)
        except InputError as error:
            complaints += [f"section '{section.id}': {problem}" for problem in error.problems]
        except Exception as error:  # the code of another package may raise anything
            complaints.append(f"section '{section.id}' cannot be shown: {type(error).__name__}: {error}")
        else:
            lines += added
            shown.append({"id": section.id, "title": section.title, "text": text})
            sigmas += section.sigmas
    assessed = _assessed(run, found, complaints)
    text = template("report.html").render(
        run=run,
        complaints=list(dict.fromkeys(complaints)),
        lines=lines,
        s=summary(run, assessed.environment, assessed.budget, assessed.acceptance),
        sections=shown,
        sigmas=[*(FIGURES if lines else ()), *dict.fromkeys(sigmas)],
        version=__version__,
    )
    return text, assessed.acceptance


@final
@dataclass(frozen=True)
class Assessed:
    """Of a run: its recorded conditions by name, the budget of a measured error, and the decision on its limit."""

    run: Run
    environment: Mapping[str, str]
    budget: Budget | None
    acceptance: Acceptance


def _assessed(run: Run, sections: Sections, complaints: list[str]) -> Assessed:
    """Sections that failed are complaints."""
    environment: dict[str, str] = {}
    contributions: list[Contribution] = []
    errors: list[Sequence[float]] = []
    for section in sections.usable:
        try:
            if section.serves(run):
                environment |= section.environment(run)
                contributions += section.contributions(run)
                errors.append(section.errors(run))
        except Exception as error:  # the code of another package, and its damaged rows, may raise anything
            complaints.append(f"section '{section.id}' has no uncertainties: {type(error).__name__}: {error}")
    budget = budget_of(run, contributions)
    return Assessed(run, dict(environment_of(run, environment)), budget, acceptance(run, budget, errors))


def assessed_run(run: Path, facts: Mapping[str, Any] | None = None) -> Assessed:
    """The run in its folder, with `facts` in place of the cell file's.

    Raises JournalError if the journal cannot be read.
    """
    return _assessed(Run.load(run).with_facts(facts or {}), Sections.installed(), [])


def _text(section: ReportSection, run: Run) -> str | None:
    """The section as HTML; None if the run has no data for it."""
    data = section.build(run) if section.serves(run) else None
    return None if data is None else template_of(section.template).render(data)


def commissioning_page(record: CellRecord) -> str:
    """The record as HTML that prints on A4: no script, nothing fetched."""
    return template("commissioning.html").render(record=record)
