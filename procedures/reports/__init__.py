"""Sections of the report that belong to kinds of campaigns (entry points `cellctl.report_sections`)."""
