"""The page of a fit, put together and written."""

from __future__ import annotations

from pathlib import Path

from cellctl import __version__
from cellctl.files import write_atomically
from cellctl.report.fit.sections import identification_sections
from cellctl.report.fit.stored import identification_rows
from cellctl.report.fit.story import FitStory
from cellctl.report.sigmas import FIGURES, IDENTIFICATION
from cellctl.report.template import template


def write_fit_page(path: Path, story: FitStory) -> None:
    """Write the report of a fit to `path`. Raises OSError."""
    write_atomically(path, fit_page(story))


def fit_page(story: FitStory) -> str:
    """The report of a fit as HTML: no script, nothing fetched, no date; the same fit gives the same bytes."""
    return template("fit.html").render(
        **identification_sections(*identification_rows(story)),
        conditions=story.conditions,
        sigmas=(*FIGURES, *IDENTIFICATION),
        version=__version__,
    )
