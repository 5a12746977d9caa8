"""Reports a run as one self-contained HTML page, built from its folder alone: the same run gives the same bytes."""

from cellctl.report._page import (
    FILE_NAME,
    ReportSection,
    Sections,
    assessed_run,
    commissioning_page,
    render,
    report_pictures,
    report_text,
    template_text,
    write_report,
)
from cellctl.report._run import Run
from cellctl.report.budget import Contribution, Sigma
from cellctl.report.compared_fits import error_curves, model_cells
from cellctl.report.drawing import (
    ACCENT,
    BEFORE,
    FAINT,
    HELD_OUT,
    INK,
    before_and_after,
    millimetres,
    one_by_one,
    svg_of,
)
from cellctl.report.figures import DASH, agreement_lines, error_line, fixed, percent, plain, significant, with_sigma
from cellctl.report.fit import FitStory, identification_rows
from cellctl.report.fit.residuals import Residuals
from cellctl.report.similarity import by_joint

__all__ = [
    "ACCENT",
    "BEFORE",
    "DASH",
    "FAINT",
    "FILE_NAME",
    "HELD_OUT",
    "INK",
    "Contribution",
    "FitStory",
    "ReportSection",
    "Residuals",
    "Run",
    "Sections",
    "Sigma",
    "agreement_lines",
    "assessed_run",
    "before_and_after",
    "by_joint",
    "commissioning_page",
    "error_curves",
    "error_line",
    "fixed",
    "identification_rows",
    "millimetres",
    "model_cells",
    "one_by_one",
    "percent",
    "plain",
    "render",
    "report_pictures",
    "report_text",
    "significant",
    "svg_of",
    "template_text",
    "with_sigma",
    "write_report",
]
