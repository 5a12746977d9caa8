"""Several models fitted to the same rows and judged on the same held-out rows: `cellctl fit --compare`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np

from cellctl.calibration import FitResult, Split, fit
from cellctl.calibration.verdict.comparison import Difference, fold_means
from cellctl.calibration.verdict.judgement import ErrorFigures
from cellctl.files import InputError
from cellctl.formats.measurements import refuse_alike
from cellctl.kinematics import Floats
from cellctl.operations.fit_options import Asked, Judging, option
from cellctl.operations.fitting import NO_CHECK, FitInput, Shown, measured_rows, silently, split_of
from cellctl.operations.results import as_json
from cellctl.operations.setup_refusals import SetupFiles, refuse_setup_errors

FIRST = "auto"
"""The first of every comparison; the others are compared with it."""

USUAL = ("geometry", "kriging", "geometry+kriging", "geometry+idw")
"""In place of `usual`: they need no column and no library that may be missing."""


@final
@dataclass(frozen=True, slots=True)
class ComparedModel:
    """One model on held-out rows. choice: as named; model: its terms. test: errors, mm. coverage_95, predicted_rms
    (mm): None where it states no σ. less: mean error less that of the first, mm, with its 95 % interval; None for the
    first. seconds: of its fits.
    """

    choice: str
    model: str
    n_parameters: int
    test: ErrorFigures
    coverage_95: float | None
    predicted_rms: float | None
    less: Difference | None
    seconds: float

    @property
    def stated_over_found(self) -> float | None:
        """Predicted over found RMS; None without σ."""
        return None if self.predicted_rms is None else self.predicted_rms / max(self.test.rms, 1e-12)


@final
@dataclass(frozen=True, eq=False)
class ComparedFits:
    """Nominal's errors on the held-out rows, mm, and each model. results: their fits; split: their rows; noun: of these
    rows, such as positions.
    """

    nominal: ErrorFigures
    models: tuple[ComparedModel, ...]
    results: tuple[FitResult, ...]
    split: Split
    noun: str

    @property
    def sentence(self) -> str:
        """Which of them have the least error, in a sentence."""
        best = min(self.models, key=lambda each: each.test.mean)
        rows = f"{self.results[0].n_test} held-out {self.noun}"
        least = f"{best.choice} leaves the least on {rows}: {best.test.mean:.3f} mm (mean)"
        if best.less is None:
            worse = [each.choice for each in self.models if each.less and each.less.low > 0.0]
            others = f"surely less than {', '.join(worse)}" if worse else "no other model leaves surely more"
            return f"{least}; {others}."
        first = f"{self.models[0].choice} with {self.models[0].test.mean:.3f} mm"
        sure = "surely less than" if best.less.high < 0.0 else "not surely less than"
        return f"{least}, {sure} {first} ({interval(best.less)} mm)."

    def figures(self) -> dict[str, Any]:
        """For JSON: rows held out, nominal's errors, and each model."""
        rows = [{**as_json(each), "stated_over_found": each.stated_over_found} for each in self.models]
        return {"n_test": self.results[0].n_test, "nominal": asdict(self.nominal), "models": rows}

    def fold_means(self, place: int) -> Floats:
        """Mean error (J,), mm, of model `place` in each fold."""
        return fold_means(self.results[place].test_errors, self.split)


def interval(less: Difference) -> str:
    """`-0.012, 95 % −0.020 … −0.004`, mm."""
    return f"{less.mean:+.3f}, 95 % {less.low:+.3f} … {less.high:+.3f}".replace("-", "−")


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
    columns = zip(names, results, seconds, strict=True)
    models = tuple(_compared(name, result, results[0], split, took) for name, result, took in columns)
    return ComparedFits(results[0].nominal, models, tuple(results), split, first.noun)


def _compared(name: str, result: FitResult, first: FitResult, split: Split, seconds: float) -> ComparedModel:
    stated = bool(np.isfinite(result.predicted_test_rms))
    return ComparedModel(
        choice=name,
        model=result.model,
        n_parameters=result.n_parameters,
        test=result.test,
        coverage_95=result.coverage_95 if stated else None,
        predicted_rms=result.predicted_test_rms if stated else None,
        less=None if result is first else Difference.of(first.test_errors, result.test_errors, split),
        seconds=round(seconds, 3),
    )
