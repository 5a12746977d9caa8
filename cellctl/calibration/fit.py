"""A fit with its proof: identified on some rows, judged on others that it never saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, final

import numpy as np

from cellctl.calibration.identify import Identification, Task, identify
from cellctl.calibration.observability import Observability, observability
from cellctl.calibration.predict import foresee
from cellctl.calibration.verdict import ErrorFigures, Verdict, paired_verdict
from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, eq=False)
class Split:
    """Rows the model is made from, and pairs (fit, held out) by which it is judged: indices into a task's rows."""

    fit: Any
    judged: tuple[tuple[Any, Any], ...]

    @classmethod
    def by_column(cls, held_out: Bools) -> Split:
        """Rows where `held_out` (N,) is true are for judging alone."""
        fit, test = np.flatnonzero(~held_out), np.flatnonzero(held_out)
        return cls(fit, ((fit, test),) if test.size else ())

    @classmethod
    def holdout(cls, rows: int, fraction: float, seed: int) -> Split:
        """A random share of the rows is held out."""
        held_out = np.zeros(rows, bool)
        held_out[np.random.default_rng(seed).permutation(rows)[: round(fraction * rows)]] = True
        return cls.by_column(held_out)

    @classmethod
    def folds(cls, rows: int, count: int, seed: int) -> Split:
        """The model is made from all rows; each fold is judged by a model made from the others."""
        order = np.random.default_rng(seed).permutation(rows)
        parts = [np.sort(part) for part in np.array_split(order, count)]
        everything = np.arange(rows)
        return cls(everything, tuple((np.setdiff1d(everything, part), part) for part in parts if part.size))


@final
@dataclass(frozen=True, eq=False)
class FitResult:
    """An identified model with its figures on the rows of the fit and on held-out rows; distances in mm.

    nominal, test, predicted_test_rms, coverage_95: held-out rows; fit: the rows of the fit. With no held-out rows
    nominal is that of the fit rows, and the verdict `no better`: nothing is proved.
    """

    identification: Identification
    observability: Observability
    model: str
    n_fit: int
    n_test: int
    nominal: ErrorFigures
    fit: ErrorFigures
    test: ErrorFigures
    predicted_test_rms: float
    coverage_95: float
    verdict: Verdict
    nominal_errors: Floats
    test_errors: Floats

    @property
    def n_parameters(self) -> int:
        """Free parameters, centres, base and tool among them."""
        return int(self.identification.identified.unknowns.free.sum())

    def summary(self) -> dict[str, Any]:
        """The figures as plain values for JSON; outliers are left to who knows the rows' lines."""
        found = self.identification.identified
        return {
            "n_fit": self.n_fit,
            "n_test": self.n_test,
            "model": self.model,
            "n_parameters": self.n_parameters,
            "rank": self.observability.rank,
            "unobservable": list(self.observability.unseen),
            "nominal": asdict(self.nominal),
            "fit": asdict(self.fit),
            "test": asdict(self.test),
            "predicted_test_rms": self.predicted_test_rms,
            "coverage_95": self.coverage_95,
            "verdict": self.verdict,
            "converged": found.converged,
            "ended": found.ended,
            "noise_growth": [float(value) for value in self.identification.noise],
        }


def fit(task: Task, split: Split) -> FitResult:
    """Identify by `split.fit` and judge by `split.judged`: of no row that judges is anything known to its model."""
    final_one = identify(task, split.fit)
    judged = [_judge(task, final_one if one is split.fit else identify(task, one), test) for one, test in split.judged]
    nominal, test, variance, inside = (np.concatenate([np.zeros(0), *parts]) for parts in _columns(judged))
    own = task.rows.pick(list(final_one.used))
    before = nominal if test.size else own.errors(final_one.nominal.state)
    return FitResult(
        identification=final_one,
        observability=observability(final_one.identified),
        model=_model_name(final_one),
        n_fit=len(own),
        n_test=int(test.size),
        nominal=ErrorFigures.of(before),
        fit=ErrorFigures.of(own.errors(final_one.identified.state)),
        test=ErrorFigures.of(test),
        predicted_test_rms=float(np.sqrt(variance.mean())) if test.size else 0.0,
        coverage_95=float(inside.mean()) if test.size else 0.0,
        verdict=paired_verdict(nominal, test),
        nominal_errors=before,
        test_errors=test,
    )


def _columns(judged: Sequence[tuple[Floats, ...]]) -> list[tuple[Floats, ...]]:
    return list(zip(*judged, strict=True)) if judged else [(), (), (), ()]


def _judge(task: Task, by: Identification, test: Any) -> tuple[Floats, Floats, Floats, Floats]:
    """Nominal errors, identified errors, their foreseen variances, and whether inside 95 %, on the held-out rows."""
    rows = task.rows.pick(test)
    foreseen = foresee(by.identified, rows.noisier(by.noise))
    errors = rows.errors(by.nominal.state), rows.errors(by.identified.state)
    return *errors, foreseen.variance, foreseen.inside.astype(float)


def _model_name(found: Identification) -> str:
    unknowns = found.identified.unknowns
    free = {group for group, is_free in zip(unknowns.groups, unknowns.free, strict=True) if is_free}
    terms = [term for term in ("geometry", "deflection") if term in free]
    return "+".join(terms) or "registration"
