"""The page of a fit, put together and written."""

from __future__ import annotations

from pathlib import Path

from cellctl import __version__
from cellctl.files import write_atomically
from cellctl.report.fit import model_section, residual_section
from cellctl.report.fit.advice import advice
from cellctl.report.fit.head import head
from cellctl.report.fit.hints import hints
from cellctl.report.fit.region import RegionSigma
from cellctl.report.fit.residuals import Residuals
from cellctl.report.fit.story import FitStory
from cellctl.report.template import template


def write_fit_page(path: Path, story: FitStory) -> None:
    """Write the report of a fit to `path`. Raises OSError."""
    write_atomically(path, fit_page(story))


def fit_page(story: FitStory) -> str:
    """The report of a fit as HTML: no script, nothing fetched, no date; the same fit gives the same bytes."""
    rows, sigma = Residuals.of(story), RegionSigma.of(story)
    return template("fit.html").render(
        head=head(story),
        distribution=residual_section.distribution(story, rows),
        joints=residual_section.by_joint(story, rows),
        places=residual_section.by_place(story, rows),
        order=residual_section.by_order(story, rows),
        scaled=residual_section.as_foreseen(rows),
        left_out=residual_section.left_out(story),
        parameters=model_section.parameters(story),
        correlation=model_section.correlation(story),
        unseen=model_section.unseen(story),
        region=model_section.region(story, sigma),
        hints=hints(story),
        advice=advice(story, sigma),
        version=__version__,
    )
