"""Errors of a model on held-out rows, and whether they are better than nominal's."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.distributions import binomial_cdf, chi2_ppf, t_ppf
from cellctl.calibration.identification.outliers import OUTLYING
from cellctl.kinematics import Bools, Floats

Verdict: TypeAlias = Literal["better", "no better", "worse"]
Baseline: TypeAlias = Literal["nominal", "prior", "both"]

UNLIKELY = 0.01
"""A low count of rows in their 95 % regions is significant at this p-value or less (binomial test). With few rows it
rarely is: of ten, seven inside are not yet (p = 0.0115)."""

FAR = 1.25
"""Errors up to this many times those predicted, in RMS, count as predicted. The RMS of n independent numbers has a
relative σ of 1/√(2n): of 20 rows with three each 0.09, of ten touches 0.22, so that this is one to three σ."""

TOO_SMALL = 1.5
"""σ that is too small by this factor is wrong: it passes with a probability of 5 % at most (power 95 %)."""

NOTHING_MM = 1e-6
"""Differences up to this are rounding."""

WORTH = 0.01
"""A gain of less than this share of the mean distance has no practical effect."""

MANY = 250
"""Nobody measures more rows than this to prove a gain: a gain that needs more is below an eighth of its scatter."""

SLIGHT = 0.1
"""A loss of less than this share of a prior model's mean distance is the cost of unnecessary free parameters on the
rows of a few folds; the model made from all rows loses less.
"""


@final
@dataclass(frozen=True, slots=True)
class ErrorFigures:
    """Mean, root mean square and greatest of a set of distances, mm; all 0 where there are none."""

    mean: float
    rms: float
    max: float

    @classmethod
    def of(cls, errors: Floats) -> ErrorFigures:
        """The figures of `errors` (N,), mm."""
        if not errors.size:
            return cls(0.0, 0.0, 0.0)
        return cls(float(errors.mean()), float(np.sqrt(np.mean(errors**2))), float(errors.max()))


def _joined(parts: Iterable[Floats]) -> Floats:
    return np.concatenate([np.zeros(0), *parts])


def _numbered(parts: Sequence[HeldOut]) -> Any:
    """The postures of all parts, which have none in common: repeats are held out together."""
    numbers, start = [np.zeros(0, int)], 0
    for part in parts:
        own = np.arange(part.nominal.size) if part.posture is None else np.unique(part.posture, return_inverse=True)[1]
        numbers.append(own.ravel() + start)
        start += int(own.max(initial=-1)) + 1
    return np.concatenate(numbers)


@final
@dataclass(frozen=True, eq=False)
class HeldOut:
    """Held-out rows: distances from the nominal and from the identified robot (N,), mm; variance (N,) of the latter as
    predicted, mm²; p_value (N,) of the error found, by that prediction; left (N,): the share of each row that remains
    after a fit to these very rows (None: all of it). prior: distances from a prior model that was updated, registered;
    None where there was none. with_tool: distances from nominal with its tool registered too, where `nominal` is that
    with the tool as stated; else None. posture (N,): number of each row's posture: repeats have the same; None: all
    differ.
    """

    nominal: Floats
    identified: Floats
    variance: Floats
    p_value: Floats
    left: Floats | None = None
    prior: Floats | None = None
    with_tool: Floats | None = None
    posture: Any = None

    @classmethod
    def joined(cls, parts: Iterable[Self]) -> Self:
        """The rows of all parts, one after another."""
        each = list(parts)
        return cls(
            nominal=_joined(part.nominal for part in each),
            identified=_joined(part.identified for part in each),
            variance=_joined(part.variance for part in each),
            p_value=_joined(part.p_value for part in each),
            left=_joined(np.ones(part.nominal.size) if part.left is None else part.left for part in each),
            prior=_joined(priors) if (priors := [part.prior for part in each if part.prior is not None]) else None,
            with_tool=_joined(tooled) if (tooled := [p.with_tool for p in each if p.with_tool is not None]) else None,
            posture=_numbered(each),
        )

    @property
    def baseline(self) -> Floats:
        """Distances (N,), mm, of nominal as the identified robot is compared with it: a tool that was never taught is
        no error of the robot.
        """
        return self.nominal if self.with_tool is None else self.with_tool

    @property
    def count(self) -> float:
        """Effective number of rows."""
        return float(self.nominal.size if self.left is None else self.left.sum())

    @property
    def states_sigma(self) -> bool:
        """Whether the model states a σ of each row."""
        return bool(np.isfinite(self.variance).all())

    @property
    def predicted_rms(self) -> float:
        """Predicted root mean square of the identified robot's distances, mm; 0 without rows, NaN without σ."""
        return float(np.sqrt(self.variance.mean())) if self.variance.size else 0.0

    @property
    def inside(self) -> Bools:
        """Which rows (N,) lie in their predicted 95 % region."""
        return np.asarray(self.p_value >= 0.05)

    @property
    def unpredicted(self) -> Bools:
        """Which rows (N,) have a very improbable error: they, or the model there, are wrong."""
        return np.asarray(self.p_value < OUTLYING)


@final
@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict and its reason, in words that follow a colon or a semicolon; against: the baseline that decided it;
    whether the stated σ can be trusted (None: the held-out rows do not show it, or no σ is stated) and the reason.
    """

    verdict: Verdict
    reason: str
    sigma_ok: bool | None
    sigma_reason: str
    against: Baseline = "nominal"


def judge(
    rows: HeldOut,
    doubts: Sequence[str] = (),
    sigma_doubts: Sequence[str] = (),
    *,
    beat_prior: bool = True,
    sigma_open: str = "",
) -> Judgement:
    """Whether the identified robot is better than nominal, by `rows`, and whether its σ can be trusted: two questions.

    doubts: why no row could show that it is better; sigma_doubts: why σ cannot be trusted, whatever the rows show;
    sigma_open: why these rows cannot show that it can.
    Beside a prior model it must also be `better` than that (beat_prior: more than registration was free), or not
    `worse` in the same paired test, except for a `SLIGHT` loss. The first of these that fails is the verdict.
    """
    sigma = _sigma_trusted(rows, sigma_doubts, sigma_open)
    verdict, reason = _compared(rows, rows.baseline, doubts)
    over_nominal = Judgement(verdict, reason, *sigma)
    if rows.prior is None:
        return over_nominal
    verdict, reason = _compared(rows, rows.prior, doubts)
    if verdict == "worse" and rows.identified.mean() - rows.prior.mean() < SLIGHT * rows.prior.mean():
        verdict, reason = "no better", "; ".join(doubts) or "it is no gain, and the loss is slight"
    over_prior = Judgement(verdict, reason, *sigma, against="prior")
    if "worse" in (over_prior.verdict, over_nominal.verdict):
        return over_prior if over_prior.verdict == "worse" else over_nominal
    if beat_prior and over_prior.verdict != "better":
        return over_prior
    both = over_nominal.verdict == over_prior.verdict == "better"
    return replace(over_nominal, against="both") if both else over_nominal


def _compared(rows: HeldOut, baseline: Floats, doubts: Sequence[str]) -> tuple[Verdict, str]:
    """Whether the identified robot is better than one with the errors `baseline` (N,), mm, and why."""
    verdict = paired_verdict(baseline, rows.identified, count=rows.count, posture=rows.posture)
    if verdict == "worse":
        return verdict, "the loss is beyond its own scatter"
    if doubts:
        return "no better", "; ".join(doubts)
    if verdict == "no better":
        return verdict, "the difference is within its own scatter"
    if baseline.mean() - rows.identified.mean() < WORTH * baseline.mean():
        return "no better", "the gain is sure, and too small to matter"
    before, after = ErrorFigures.of(baseline).rms, ErrorFigures.of(rows.identified).rms
    if after >= before:
        return "no better", f"the mean is smaller, the root mean square is not ({before:.3f} → {after:.3f})"
    return "better", "the gain is beyond its own scatter"


def _sigma_trusted(rows: HeldOut, doubts: Sequence[str], cannot_show: str) -> tuple[bool | None, str]:
    if not rows.identified.size:
        return None, "no row was held out"
    if not rows.states_sigma:
        return None, "the model states no σ"
    if doubts:
        return False, "; ".join(doubts)
    found = ErrorFigures.of(rows.identified).rms
    inside = f"{int(rows.inside.sum())} of {rows.inside.size} held-out rows lie in their 95 % region"
    figures = f"{inside}; {rows.predicted_rms:.3f} mm RMS predicted, {found:.3f} found"
    if not _predicted(rows, found):
        return False, figures
    if cannot_show:
        return None, f"{figures}; {cannot_show}"
    most = _most_error_over_sigma(rows)
    if most < TOO_SMALL:
        return True, figures
    return None, f"{figures}; errors may be {most:.1f} times σ (95 %): too few rows, or too uneven errors, to tell"


def _predicted(rows: HeldOut, found: float) -> bool:
    """Whether the found errors (`found`: their RMS, mm) are those predicted, by coverage or by size.

    One of both is enough, and both are one-sided: a σ that is too large passes.
    """
    count = max(round(rows.count), 1)
    covered = float(binomial_cdf(round(float(rows.inside.mean()) * count), count, 0.95)) >= UNLIKELY
    return covered or rows.predicted_rms * FAR >= found


def _most_error_over_sigma(rows: HeldOut) -> float:
    """Upper 95 % bound of the RMS of error over predicted σ; infinite for fewer than two postures.

    The larger of two bounds on the mean of the squared ratios: by their own scatter (t quantile), as errors of a model
    are not normal, and by χ² with one degree of freedom for each posture, exact for touches, as few squares are skew.
    Repeats of a posture count as one. Errors of the predicted size pass from about 15 postures on.
    """
    ratio = rows.identified**2 / np.maximum(rows.variance, NOTHING_MM**2)
    if rows.posture is not None:
        _, which, repeats = np.unique(rows.posture, return_inverse=True, return_counts=True)
        ratio = np.bincount(which.ravel(), ratio) / repeats
    count, mean = ratio.size * rows.count / max(rows.identified.size, 1), float(ratio.mean())
    if ratio.size < 2 or count < 2.0:
        return float("inf")
    by_scatter = mean + float(t_ppf(0.95, count - 1.0)) * float(ratio.std(ddof=1)) / float(np.sqrt(count))
    return float(np.sqrt(max(by_scatter, mean * count / float(chi2_ppf(0.05, count)))))


def paired_verdict(nominal: Floats, identified: Floats, *, count: float | None = None, posture: Any = None) -> Verdict:
    """Whether the identified model's errors (N,), mm, are below nominal's on the same held-out rows.

    Paired t test on the difference of the two errors row by row, two-sided at 5 %: common causes (a far corner of the
    workspace, a noisy hour) cancel, and a gain that a few favourable rows could explain is `no better`. Fewer than
    three rows prove nothing. count: effective number of rows, if fewer: four touches that find their own sphere count
    as one.

    posture (N,): repeats of a posture count as one row, their mean. They have a common error of the model: taken as
    independent, with 20 postures, each five times, a model that is as good as nominal is `better` in 19 of 100 draws,
    not in 2.5 (simulated: error of the model 1, of a repeat 0.3). The rows of one label (`--by`) are still taken as
    independent.
    """
    gain = nominal - identified
    rows = gain.size if count is None else count
    if posture is not None and gain.size:
        _, which, repeats = np.unique(posture, return_inverse=True, return_counts=True)
        if len(repeats) < gain.size:
            rows *= len(repeats) / gain.size
            gain = np.bincount(which.ravel(), gain) / repeats
    if rows < 3 or float(np.abs(gain).max()) < NOTHING_MM:
        return "no better"
    bound = float(_bound(gain, rows))
    if gain.mean() > bound:
        return "better"
    return "worse" if gain.mean() < -bound else "no better"


def rows_for_better(nominal: Floats, identified: Floats) -> int | None:
    """The least number of rows, up to `MANY`, on which errors (N,), mm, with this mean and scatter of their difference
    would be `better` in `paired_verdict`; None where there is no such number.

    New rows with this true mean and scatter are then `better` in about half of all cases (power 0.5).
    """
    gain, rows = nominal - identified, np.arange(3, MANY + 1)
    enough = rows[gain.mean() > _bound(gain, rows)]
    return int(enough[0]) if enough.size else None


def _bound(gain: Floats, rows: Any) -> Any:
    """A mean of `rows` differences with the scatter of `gain` (N,), mm, is significant beyond this, mm."""
    return t_ppf(0.975, np.asarray(rows) - 1) * gain.std(ddof=1) / np.sqrt(rows)


def verdict_sentence(
    verdict: Verdict,
    nominal: ErrorFigures,
    test: ErrorFigures,
    rows: int,
    kind: str,
    reason: str = "the difference is within its own scatter",
    prior: ErrorFigures | None = None,
    against: Baseline = "nominal",
    *,
    with_tool: bool = False,
) -> str:
    """The verdict in sentences: what was measured, before, after; then better, no better (and the `reason`) or worse.

    rows: how many were held out; kind: their name. prior: figures of a prior model; against: the deciding baseline;
    with_tool: `nominal` has its tool registered.
    """
    named = "nominal with the tool registered" if with_tool else "nominal"
    before = "nominal robot" if not with_tool else named
    names = (before, "prior model", "identified robot") if prior else (named if with_tool else "before", "after")
    figures = (nominal, prior, test) if prior else (nominal, test)
    than = {"nominal": named, "prior": "the prior model", "both": f"{named} and the prior model"}[against]
    measured = f"Error of held-out {kind}: {compared_errors(names, figures, rows)}."
    match verdict:
        case "better":
            beside = ", no worse than the prior model" if prior and against == "nominal" else ""
            return f"{measured} Better than {than}{beside}."
        case "worse":
            return f"{measured} Worse than {than}: do not use this model."
        case _:
            return f"{measured} No better than {than}: {reason}."


def compared_errors(names: Sequence[str], figures: Sequence[ErrorFigures], rows: int) -> str:
    """Means and greatest of errors side by side: `1.773 mm before, 0.027 mm after (mean of 30; max 4.17, 0.07 mm)`."""
    means = ", ".join(f"{each.mean:.3f} mm {name}" for name, each in zip(names, figures, strict=True))
    return f"{means} (mean of {rows}; max {', '.join(f'{each.max:.3f}' for each in figures)} mm)"
