"""Several models fitted to the same rows and judged on the same held-out rows: `cellctl fit --compare`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cellctl.calibration import fit
from cellctl.calibration.verdict.comparison import ComparedFits
from cellctl.files import InputError
from cellctl.formats.measurements import refuse_alike
from cellctl.operations.fit_options import Asked, Judging, option
from cellctl.operations.fitting import NO_CHECK, FitInput, Shown, measured_rows, silently, split_of
from cellctl.operations.setup_refusals import SetupFiles, refuse_setup_errors

FIRST = "auto"
"""The first of every comparison; the others are compared with it."""

USUAL = ("geometry", "kriging", "geometry+kriging", "geometry+idw")
"""In place of `usual`: they need no column and no library that may be missing."""


def compare_fits(
    given: FitInput, asked: Asked, judging: Judging, choices: Sequence[str], shown: Shown | None = None, *, check: bool
) -> ComparedFits:
    """`auto` and each of `choices`, on the same rows and folds. Raises InputError where one cannot be fitted."""
    names = tuple(dict.fromkeys([FIRST, *(each for one in choices for each in (USUAL if one == "usual" else (one,)))]))
    progress, first, results, seconds = shown or silently, None, [], []
    for name in names:
        began = time.perf_counter()
        measured = measured_rows(given, replace(asked, model=name))
        if first is None:
            refuse_alike(measured)
            first, (split, _) = measured, split_of(measured, judging)
            if not split.judged:
                raise InputError(option("compare", "no row is held out", "--folds 5, --holdout 0.3 or --column set"))
            if check:
                files = SetupFiles(given.document, Path(given.data.file), asked.artefact)
                with progress("check") as told:
                    refuse_setup_errors(measured, files, NO_CHECK, told)
        with progress(name) as told:
            try:
                results.append(fit(measured.task, split, told))
            except ValueError as error:
                raise InputError(option("compare", f"{name}: {error}", "leave this model out")) from error
        seconds.append(time.perf_counter() - began)
    assert first is not None
    return ComparedFits.of(names, results, seconds, split, first.noun)
