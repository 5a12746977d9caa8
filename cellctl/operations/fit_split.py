"""The rows of a fit, and its held-out rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.files import InputError, Problem
from cellctl.operations.fit_options import Judging, option

if TYPE_CHECKING:
    from cellctl.calibration import Split
    from cellctl.formats import Measurements

DEFAULT_FOLDS = 5
MOST_LABELS = 100
"""A column with more values than this is a number, not a label."""


def split_of(measured: Measurements, judging: Judging) -> tuple[Split, list[str]]:
    """The split, and with `--by` the label of each held-out row. Raises InputError if there is no such split."""
    split = _enough(measured, _split(measured, judging))
    if judging.by is None:
        return split, []
    labels = measured.texts(judging.by)
    return split, [labels[row] for _, test in split.judged for row in test]


def _split(measured: Measurements, judging: Judging) -> Split:
    import numpy as np

    from cellctl.calibration import Split

    rows, postures = len(measured.lines), measured.postures()
    if judging.by is not None:
        return Split.leaving_out(_labels(measured, judging.by))
    if judging.holdout is not None:
        return Split.holdout(rows, judging.holdout, judging.seed, postures)
    if judging.folds is None and (judging.column or any(measured.sets)):
        if not any(measured.sets):
            cure = "add it, with fit or test in each row"
            raise InputError(option("column", "the data set has no column set", cure))
        return Split.by_column(np.array([name == "test" for name in measured.sets]))
    if judging.folds is not None and judging.folds > rows:
        what = f"{judging.folds} folds, but the data set has {rows} usable rows"
        raise InputError(option("folds", what, f"{rows} or fewer"))
    return Split.folds(rows, min(judging.folds or DEFAULT_FOLDS, len(set(postures))), judging.seed, postures)


def _labels(measured: Measurements, column: str) -> list[str]:
    if not measured.data.has(column):
        cure = f"columns here: {', '.join(measured.data.columns[:12])}"
        raise InputError(option("by", f"the data set has no column '{column}'", cure))
    labels = measured.texts(column)
    count = len(set(labels))
    if not all(labels):
        line = measured.lines[labels.index("")]
        raise InputError(
            option("by", f"column '{column}' is empty in line {line}", "fill it in, or leave that row out")
        )
    if count < 2:
        what = f"column '{column}' has one value, '{labels[0]}': nothing would be left to fit"
        raise InputError(option("by", what, "a column with two values or more"))
    if count > MOST_LABELS or count == len(labels):
        what = f"column '{column}' has {count} values in {len(labels)} rows: it is a number, not a label"
        raise InputError(option("by", what, f"a column with at most {MOST_LABELS} values, several rows for each"))
    return labels


def _enough(measured: Measurements, split: Split) -> Split:
    """`split`, unless a part of it has fewer different rows than registration alone has unknowns."""
    import numpy as np

    least, seen = measured.task.rows_at_least, np.array(measured.sightings())
    parts = [split.fit, *(part for part, _ in split.judged)]
    fewest, rows = min((len(np.unique(seen[part])), len(part)) for part in parts)
    if fewest >= least:
        return split
    repeated = f" in {fewest} postures" if fewest < rows else ""
    what = f"{rows} rows to fit{repeated} where even the registration takes {least}"
    raise InputError(Problem("the data set", 0, 0, what, "measure more, or hold out less"))
