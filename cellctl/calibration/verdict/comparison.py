"""Models on the same held-out rows, and the difference of their errors, with an interval for overlapping folds.

With J folds the models of two folds share most of their rows, so the differences d_j of the folds are not independent:
their variance S² / J is too small, and a paired t test finds differences where there are none in up to half of all
cases. Nadeau and Bengio (2003, Inference for the generalization error, Machine Learning 52, section 3) estimate the
variance of the mean of d_j by

    (1/J + n_test / n_train) S²,    S²: sample variance of d_j

with J − 1 degrees of freedom. With one split there is no overlap: rows are the sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.distributions import t_ppf
from cellctl.calibration.verdict.fit import FitResult
from cellctl.calibration.verdict.judgement import ErrorFigures
from cellctl.calibration.verdict.proof import Split
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, slots=True)
class Difference:
    """Mean of b − a, mm, and its 95 % interval; infinite where two folds or rows are missing."""

    mean: float
    low: float
    high: float

    @classmethod
    def of(cls, a: Floats, b: Floats, split: Split) -> Self:
        """Of errors (N,), mm, of the held-out rows of `split`, in its order."""
        folds = fold_means(b - a, split)
        if len(folds) > 1:
            overlap = float(np.mean([len(test) / len(fit) for fit, test in split.judged]))
            return cls._about(folds, 1.0 / len(folds) + overlap)
        return cls._about(b - a, 1.0 / len(b)) if len(b) else cls(0.0, -np.inf, np.inf)

    @classmethod
    def _about(cls, sample: Floats, factor: float) -> Self:
        """factor: of the sample's variance, for that of its mean."""
        mean = float(sample.mean())
        if len(sample) < 2:
            return cls(mean, -np.inf, np.inf)
        half = float(t_ppf(0.975, len(sample) - 1)) * float(np.sqrt(factor * sample.var(ddof=1)))
        return cls(mean, mean - half, mean + half)

    @property
    def decided(self) -> bool:
        """Whether the interval is on one side of 0."""
        return self.low > 0.0 or self.high < 0.0


def fold_means(values: Floats, split: Split) -> Floats:
    """Mean of the values (N,) of each fold's held-out rows (J,)."""
    ends: Sequence[int] = np.cumsum([len(test) for _, test in split.judged])[:-1].tolist()
    return np.array([part.mean() for part in np.split(values, ends) if part.size])


@final
@dataclass(frozen=True, slots=True)
class ComparedModel:
    """One model on held-out rows. choice: as named; model: its terms. test: errors, mm. coverage_95, predicted_rms
    (mm): None where it states no σ. less: mean error less that of the first, mm, with its 95 % interval; None for the
    first, and where one row shows no interval.
    """

    choice: str
    model: str
    n_parameters: int
    test: ErrorFigures
    coverage_95: float | None
    predicted_rms: float | None
    less: Difference | None

    @property
    def stated_over_found(self) -> float | None:
        """Predicted over found RMS; None without σ."""
        return None if self.predicted_rms is None else self.predicted_rms / max(self.test.rms, 1e-12)


@final
@dataclass(frozen=True, eq=False)
class ComparedFits:
    """Nominal's errors on the held-out rows, mm, and each model. results: their fits; seconds: that these took; split:
    their rows; noun: of these rows, such as positions.
    """

    nominal: ErrorFigures
    models: tuple[ComparedModel, ...]
    results: tuple[FitResult, ...]
    seconds: tuple[float, ...]
    split: Split
    noun: str

    @classmethod
    def of(
        cls, choices: Sequence[str], results: Sequence[FitResult], seconds: Sequence[float], split: Split, noun: str
    ) -> Self:
        """Of the fits of `choices` with this split, the first one first."""
        models = compared_models(choices, results, split)
        return cls(results[0].nominal, models, tuple(results), tuple(round(each, 3) for each in seconds), split, noun)

    @property
    def sentence(self) -> str:
        """Which of them have the least error, in a sentence."""
        best = min(self.models, key=lambda each: each.test.mean)
        rows = f"{self.results[0].n_test} held-out {self.noun}"
        least = f"{best.choice} leaves the least on {rows}: {best.test.mean:.3f} mm (mean)"
        if best is self.models[0]:
            worse = [each.choice for each in self.models if each.less and each.less.low > 0.0]
            others = f"surely less than {', '.join(worse)}" if worse else "no other model leaves surely more"
            return f"{least}; {others}."
        first = f"{self.models[0].choice} with {self.models[0].test.mean:.3f} mm"
        if best.less is None:
            return f"{least}; one row does not show whether it is less than {first}."
        sure = "surely less than" if best.less.high < 0.0 else "not surely less than"
        return f"{least}, {sure} {first} ({interval(best.less)} mm)."

    def report(self) -> dict[str, Any]:
        """For JSON: rows held out, nominal's errors, each model, and the sentence."""
        rows = [
            {**asdict(each), "seconds": took, "stated_over_found": each.stated_over_found}
            for each, took in zip(self.models, self.seconds, strict=True)
        ]
        head = {"n_test": self.results[0].n_test, "nominal": asdict(self.nominal)}
        return {**head, "models": rows, "sentence": self.sentence}

    def fold_means(self, place: int) -> Floats:
        """Mean error (J,), mm, of model `place` in each fold."""
        return fold_means(self.results[place].test_errors, self.split)


def interval(less: Difference) -> str:
    """`-0.012, 95 % −0.020 … −0.004`, mm."""
    return f"{less.mean:+.3f}, 95 % {less.low:+.3f} … {less.high:+.3f}".replace("-", "−")


def compared_models(choices: Sequence[str], results: Sequence[FitResult], split: Split) -> tuple[ComparedModel, ...]:
    """The fits of `choices` with this split, each compared with the first one."""
    return tuple(_compared(name, result, results[0], split) for name, result in zip(choices, results, strict=True))


def _compared(name: str, result: FitResult, first: FitResult, split: Split) -> ComparedModel:
    stated = bool(np.isfinite(result.predicted_test_rms))
    less = None if result is first else Difference.of(first.test_errors, result.test_errors, split)
    return ComparedModel(
        choice=name,
        model=result.model,
        n_parameters=result.n_parameters,
        test=result.test,
        coverage_95=result.coverage_95 if stated else None,
        predicted_rms=result.predicted_test_rms if stated else None,
        less=less if less is not None and np.isfinite(less.low) else None,
    )
