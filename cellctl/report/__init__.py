"""Reports a run as one self-contained HTML page, built from its folder alone: the same run gives the same bytes."""

from cellctl.report._page import (
    FILE_NAME,
    ReportSection,
    Sections,
    commissioning_page,
    render,
    report_pictures,
    report_text,
    template_text,
    write_report,
)
from cellctl.report._run import Run
from cellctl.report.budget import Contribution, Sigma

__all__ = [
    "FILE_NAME",
    "Contribution",
    "ReportSection",
    "Run",
    "Sections",
    "Sigma",
    "commissioning_page",
    "render",
    "report_pictures",
    "report_text",
    "template_text",
    "write_report",
]
