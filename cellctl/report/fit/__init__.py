"""A fit as one self-contained HTML page: residuals, parameters, unobservable parameters, what to measure next.

`page` draws it. What a run stores of a fit is here: it draws nothing, so a run does not load matplotlib.
"""

from cellctl.report.fit._rows import identification_rows
from cellctl.report.fit._story import FitStory

__all__ = ["FitStory", "identification_rows"]
