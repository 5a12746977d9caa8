"""Sections of a run's report, found by the entry points `cellctl.report_sections`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from importlib.resources import files
from typing import Any, Self, final

from cellctl.records import Row
from cellctl.report.budget import Contribution
from cellctl.report.run import Run
from cellctl.report.sigmas import Sigma

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
    text of each recorded condition. contributions: to the uncertainty budget, of what the section knows.
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
        for name, value, point in sorted((point.name, point.value, point) for point in entry_points(group=GROUP)):
            try:
                section = point.load()
            except Exception as error:  # the code of another package may raise anything
                broken.append(f"section '{name}' ({value}) cannot be loaded: {error}")
                continue
            if not isinstance(section, ReportSection):
                broken.append(f"section '{name}' ({value}) is no ReportSection")
            elif found.setdefault(section.id, section) is not section:
                broken.append(f"section '{name}' ({value}): there is another section '{section.id}'")
        return cls.of(found.values(), broken)


def template_text(package: str, name: str) -> str:
    """The text of the template file `name` beside the module of a package."""
    return (files(package) / name).read_text(encoding="utf-8")
