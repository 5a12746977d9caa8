"""Report sections of specific kinds of campaigns (entry points `cellctl.report_sections`)."""
