"""A fit as one self-contained HTML page: residuals, parameters, unobservable parameters, what to measure next."""

from cellctl.report.fit._page import fit_page, identification_rows, write_fit_page
from cellctl.report.fit._story import FitStory

__all__ = ["FitStory", "fit_page", "identification_rows", "write_fit_page"]
