"""A run as one self-contained HTML page, rebuilt from its folder alone: the same run gives the same bytes."""

from cellctl.report.page import FILE_NAME, report_text, write_report

__all__ = ["FILE_NAME", "report_text", "write_report"]
