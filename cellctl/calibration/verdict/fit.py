"""A fit with its proof: identified on some rows, judged on held-out rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.effects import functions, kinds
from cellctl.calibration.identification.identify import Identification, certified_rows, identify, inliers_among
from cellctl.calibration.identification.ladder import Step, climb
from cellctl.calibration.identification.moved import Placing, placing
from cellctl.calibration.identification.progress import Progress, part_of, silent
from cellctl.calibration.model.learnt_map import learnt_maps
from cellctl.calibration.observability.other_postures import in_their_sockets
from cellctl.calibration.observability.reasons import Rowed
from cellctl.calibration.observability.unobservable import Observability, informed, observability
from cellctl.calibration.prediction.predict import REGION_POINTS, sigma_among
from cellctl.calibration.problem.measured_region import OUTSIDE, MeasuredRegion
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.solver.estimate import Estimate, triangle_at_start
from cellctl.calibration.verdict.distribution_free import DistributionFreeBound
from cellctl.calibration.verdict.heldout import held_out_rows, nominal_errors
from cellctl.calibration.verdict.judgement import Baseline, ErrorFigures, HeldOut, Verdict, judge
from cellctl.calibration.verdict.proof import Split, doubts, sigma_doubts
from cellctl.calibration.verdict.reliability import Reliability, mostly_outside
from cellctl.kinematics import Floats
from cellctl.kinematics.low_discrepancy import spread_over

FoldFits: TypeAlias = Callable[[Sequence[int]], Iterable[HeldOut]]
"""Takes parts of `Split.judged`, by their numbers; gives what `held_out_fold` gives for each, in their order."""

INLIERS_FOUND, TERMS_CHOSEN, IDENTIFIED = 0.1, 0.5, 0.8
"""Shares of the work of `auto` that are done after each stage. Measured on 100, 1000 and 12 000 positions: 0.09 … 0.16,
0.41 … 0.59 and 0.58 … 0.93. They matter until a first identification has shown its own."""

_PARTLY_SHOWN = "rows at fixed points do not show the whole error of the TCP"
_GAPS = "most combinations of these joint angles were not measured"


@final
@dataclass(frozen=True, eq=False)
class FitResult:
    """An identified model with its figures on the rows of the fit and on held-out rows; distances in mm.

    nominal, test, predicted_test_rms, coverage_95: held-out rows; fit: the rows of the fit. With no held-out rows
    nominal is that of the fit rows, and the verdict is `no better`: there is no proof. verdict_reason: the reason, in
    words. sigma_ok, sigma_reason: whether the predicted errors can be trusted, and why (None: the held-out rows do not
    show it, or the model states no σ); without σ predicted errors and coverage are NaN.
    predicted_volumetric_rms: 1 σ of the model, 3-D, over its measured region, without common rigid motions: residuals
    on spheres cannot show it. It has the scatter of errors too fast for the model. at_postures: it is over the measured
    and held-out postures instead, because combinations of base and tool are unobservable (`placement`: at other
    orientations the tool would be wrong by up to their whole tolerance), or because the rows leave most of the joint
    ranges open (`gaps`). unpredicted: indices of held-out rows far beyond the model's
    prediction, unpredicted_mm: their errors, predicted_mm: 1 σ (3-D) predicted for each; they are included in the
    figures. test_errors, test_p_values: of the held-out rows, mm, in the order of the split; a p-value is the
    probability of an error at least as improbable. ladder: the models tried, if the task left the terms open.

    nominal_with_tool: of socket visits, nominal with its tool registered too: `nominal` has only the sockets' places
    fitted, and the verdict compares with this one. prior: a prior model, registered, on the rows of `nominal`; None
    without one. against: what decided the verdict.
    placing: how far the prior model was off before it was registered. informed: whether the rows determined the robot's
    own parameters: a prior model's measured region grows by these rows only then.
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
    predicted_volumetric_rms: float
    verdict: Verdict
    verdict_reason: str
    sigma_ok: bool | None
    sigma_reason: str
    unpredicted: tuple[int, ...]
    unpredicted_mm: tuple[float, ...]
    predicted_mm: tuple[float, ...]
    nominal_errors: Floats
    test_errors: Floats
    test_p_values: Floats
    reliability: Reliability
    region: MeasuredRegion
    distribution_free: DistributionFreeBound
    ladder: tuple[Step, ...] = ()
    prior: ErrorFigures | None = None
    prior_errors: Floats | None = None
    against: Baseline = "nominal"
    nominal_with_tool: ErrorFigures | None = None
    nominal_with_tool_errors: Floats | None = None
    placing: Placing | None = None
    informed: bool = True
    at_postures: Literal["", "placement", "gaps"] = ""

    @property
    def predicted_over(self) -> str:
        """In words: where `predicted_volumetric_rms` holds, and if it does not hold elsewhere, the reasons."""
        if self.at_postures:
            hidden = [each.reason for each in self.observability.hidden if not each.harmless]
            reasons = hidden if self.at_postures == "placement" else [_GAPS]
            return "the measured and held-out postures" + (f" (not elsewhere: {', '.join(reasons)})" if reasons else "")
        return "the joints of the fit" if self.prior is None else "the measured region"

    @property
    def n_parameters(self) -> int:
        """Free parameters, centres, base and tool among them; the coefficients of random functions are not."""
        unknowns = self.identification.identified.unknowns
        return int((unknowns.free & ~unknowns.among(functions())).sum())

    def summary(self) -> dict[str, Any]:
        """The figures as plain values for JSON; without outliers, which the caller names by line."""
        found = self.identification.identified
        return {
            "n_fit": self.n_fit,
            "n_test": self.n_test,
            "model": self.model,
            "n_parameters": self.n_parameters,
            "rank": self.observability.rank,
            "unobservable": list(self.observability.unseen),
            "unseen": [hidden.summary() for hidden in self.observability.hidden],
            "nominal": asdict(self.nominal),
            "nominal_with_tool": asdict(self.nominal_with_tool) if self.nominal_with_tool else None,
            "prior": asdict(self.prior) if self.prior else None,
            "prior_as_is_rms": self.placing.as_is_mm if self.placing else None,
            "informed": self.informed,
            "fit": asdict(self.fit),
            "test": asdict(self.test) if self.n_test else dict.fromkeys(asdict(self.test)),
            "predicted_test_rms": _stated(self.predicted_test_rms) if self.n_test else None,
            "coverage_95": _stated(self.coverage_95) if self.n_test else None,
            "tails": self.reliability.tails,
            "predicted_volumetric_rms": _stated(self.predicted_volumetric_rms),
            "scatter_mm": self.region.scatter_mm,
            "model_error_scale": self.region.model_error_scale,
            "radius_95": self.region.radius_95,
            "distribution_free": self.distribution_free.summary(),
            "predicted_over": self.predicted_over,
            "verdict": self.verdict,
            "verdict_reason": self.verdict_reason,
            "compared_with": self.against,
            "sigma_ok": self.sigma_ok,
            "sigma_reason": self.sigma_reason,
            "converged": found.converged,
            "ended": found.ended,
            "ladder": [asdict(step) for step in self.ladder],
            "loosened": dict(self.identification.prior_scale),
            "noise_growth": [float(value) for value in self.identification.noise],
        }


@final
@dataclass(frozen=True, eq=False)
class _Fitted:
    """A model identified from some rows, with the terms that they support, and the reliability of its σ."""

    task: Task
    identification: Identification
    reliability: Reliability
    ladder: tuple[Step, ...]

    @classmethod
    def of(cls, task: Task, fit: Any, predicted: Any, progress: Progress) -> Self:
        """From the rows at `fit`; predicted: the rows to be predicted, of which only the postures are used."""
        progress("identifying", 0.0)
        if task.candidates is None:
            return cls._with_reliability(task, identify(task, fit), ())
        rows = task.rows.pick(fit)
        kept, n_inconsistent = inliers_among(replace(task, candidates=None), rows)
        progress("terms", INLIERS_FOUND)
        outside = mostly_outside(rows.pick(kept).q, task.rows.pick(predicted).q)
        chosen = climb(task, rows.pick(kept), part_of(progress, INLIERS_FOUND, TERMS_CHOSEN), outside=outside)
        progress("chosen terms", TERMS_CHOSEN)
        found = identify(chosen.task, fit, (kept, n_inconsistent), chosen.scales)
        progress("σ of predictions", IDENTIFIED)
        return cls._with_reliability(chosen.task, found, chosen.steps)

    @classmethod
    def _with_reliability(cls, task: Task, found: Identification, ladder: tuple[Step, ...]) -> Self:
        return cls(task, found, Reliability.of(task, found), ladder)

    def held_out(self, test: Any) -> HeldOut:
        """The rows at `test` as this predicts them."""
        return held_out_rows(self.task, self.identification, self.task.rows.pick(test), self.reliability)


def fit(task: Task, split: Split, progress: Progress = silent, folds: FoldFits | None = None) -> FitResult:
    """Identify from `split.fit` and judge by `split.judged`: a model has no information from the rows that judge it.

    If the task leaves the model's terms open, each part of the split selects them from its own rows. folds: predicts
    the parts that have a fit of their own (`split.folds_apart`), once the model is there, and reports their progress
    itself; default: one after another.
    """
    apart = split.folds_apart
    count = 1 if folds else 1 + len(apart)
    predicted = np.concatenate([np.zeros(0, int), *(test for _, test in split.judged)])
    whole = _Fitted.of(task, split.fit, predicted, part_of(progress, 0.0, 1.0 / count, "model" if apart else ""))
    given, task, final_one = task, whole.task, whole.identification

    def in_turn(numbers: Sequence[int]) -> Iterable[HeldOut]:
        for done, number in enumerate(numbers, 1):
            name = f"fold {done} of {len(numbers)}"
            yield held_out_fold(given, split, number, part_of(progress, done / count, (done + 1) / count, name))

    others = dict(zip(apart, (folds or in_turn)(apart), strict=True))
    held_out = HeldOut.joined(
        others[number] if number in others else whole.held_out(test) for number, (_, test) in enumerate(split.judged)
    )
    progress("figures", 1.0)
    own = task.rows.pick(list(final_one.used))
    nominal, prior = _baselines(task, final_one, held_out, own)
    place = placing(task, final_one.nominal.state, own)
    judgement = judge(
        held_out,
        doubts(task, split, final_one),
        sigma_doubts(task, final_one),
        sigma_open="" if task.rows.pick(predicted).of_instrument.any() else _PARTLY_SHOWN,
        beat_prior=not (task.registers_only or (not task.is_partial_update and place is not None and place.moved)),
    )
    own_parameters = informed(final_one.identified)
    region = whole.reliability.region if task.region is None or own_parameters else task.region
    ranges = spread_over(region.lower, region.upper, REGION_POINTS, scramble=False)
    at_postures = _why_at_postures(final_one.identified, ranges, region)
    return FitResult(
        identification=final_one,
        observability=_observability(task, final_one, own),
        model=_model_name(final_one),
        n_fit=len(own),
        n_test=int(held_out.identified.size),
        nominal=ErrorFigures.of(nominal),
        fit=ErrorFigures.of(own.errors(final_one.identified.state)),
        test=ErrorFigures.of(held_out.identified),
        predicted_test_rms=held_out.predicted_rms,
        coverage_95=_coverage(held_out),
        predicted_volumetric_rms=_over(
            final_one.identified,
            np.concatenate([own.q, task.rows.pick(predicted).q]) if at_postures else ranges,
            region,
        ),
        verdict=judgement.verdict,
        verdict_reason=judgement.reason,
        sigma_ok=judgement.sigma_ok,
        sigma_reason=judgement.sigma_reason,
        **_unpredicted(split, held_out),
        nominal_errors=nominal,
        test_errors=held_out.identified,
        test_p_values=held_out.p_value,
        ladder=whole.ladder,
        reliability=whole.reliability,
        region=region,
        distribution_free=DistributionFreeBound.of(task, final_one, region),
        prior=None if prior is None else ErrorFigures.of(prior),
        prior_errors=prior,
        against=judgement.against,
        nominal_with_tool=None if held_out.with_tool is None else ErrorFigures.of(held_out.with_tool),
        nominal_with_tool_errors=held_out.with_tool,
        placing=place,
        informed=own_parameters,
        at_postures=at_postures,
    )


def held_out_fold(task: Task, split: Split, number: int, progress: Progress = silent) -> HeldOut:
    """The held-out rows of part `number` of `split.judged`, as a model identified from that part's own rows predicts
    them.
    """
    one, test = split.judged[number]
    return _Fitted.of(task, one, test, progress).held_out(test)


def _coverage(held_out: HeldOut) -> float:
    """Share of the held-out rows in their 95 % regions; 0 without rows, NaN without σ."""
    if not held_out.states_sigma:
        return float("nan")
    return float(held_out.inside.mean()) if held_out.inside.size else 0.0


def _stated(figure: float) -> float | None:
    """None for a figure that needs a σ, of a model that states none."""
    return None if np.isnan(figure) else figure


def _baselines(task: Task, found: Identification, held_out: HeldOut, own: RowBlocks) -> tuple[Floats, Floats | None]:
    """Errors, mm, of nominal and of a prior model on the held-out rows; where there are none, on those of the fit."""
    if held_out.nominal.size:
        return held_out.nominal, held_out.prior
    before = own.errors(found.nominal.state)
    return (before, None) if task.nominal is None else (nominal_errors(task, own, own), before)


def _observability(task: Task, found: Identification, own: RowBlocks) -> Observability:
    # in units of the prior σ as stated: a scaled prior makes every combination seem better observable
    given = found.identified.unknowns
    parameters = ~given.among(functions())  # coefficients of a random function are not counted one by one
    unknowns = replace(given.masked(parameters), sigma=found.nominal.unknowns.sigma)
    rows = [in_their_sockets(block, unknowns.start) for block in own.noisier(found.noise).blocks]
    seen = triangle_at_start(unknowns, [*rows, *certified_rows(task)])
    if unknowns.pinned is not None and len(unknowns.pinned):  # R (I − P Pᵀ), P a basis of them: singular value 0
        pins = np.linalg.qr(unknowns.pinned[:, unknowns.free].T)[0]
        seen = seen - (seen @ pins) @ pins.T
    return observability(
        replace(found.identified, unknowns=unknowns), seen, Rowed(unknowns, tuple(rows), task.spacings)
    )


def _unpredicted(split: Split, held_out: HeldOut) -> dict[str, Any]:
    """Held-out rows far beyond the prediction: indices, errors and predicted errors."""
    places = np.concatenate([np.zeros(0, int), *(np.asarray(test, int) for _, test in split.judged)])
    which = held_out.unpredicted
    columns = (places[which], held_out.identified[which], np.sqrt(held_out.variance[which]))
    found = sorted(zip(*(column.tolist() for column in columns), strict=True))
    rows, errors, expected = zip(*found, strict=True) if found else ((), (), ())
    return {"unpredicted": rows, "unpredicted_mm": errors, "predicted_mm": expected}


def _why_at_postures(found: Estimate, ranges: Floats, region: MeasuredRegion) -> Literal["", "placement", "gaps"]:
    """Why σ over the joint ranges (N, n), rad, says nothing: combinations of base and tool are open by their whole
    tolerance (`Unknowns.pinned`); or most of the ranges is outside the measured region. Empty: it does.
    """
    pinned = found.unknowns.pinned
    if pinned is not None and bool((np.linalg.norm(pinned, axis=1) <= 1.0 + 1e-9).any()):
        return "placement"
    return "gaps" if float(np.median(region.coverage.remainder(ranges))) > OUTSIDE else ""


def _over(found: Estimate, q: Floats, region: MeasuredRegion) -> float:
    """1 σ, 3-D, mm, of the model at angles q (N, n), rad, without common rigid motions."""
    robot = found.unknowns.robot
    return sigma_among(found.state.model, found.covariance[:robot, :robot], q, region)


def _model_name(found: Identification) -> str:
    unknowns = found.identified.unknowns
    free = {group for group, is_free in zip(unknowns.groups, unknowns.free, strict=True) if is_free}
    if free & {"links", "zeros"}:
        free = {"geometry" if group == "links" else group for group in free} - ({"zeros"} if "links" in free else set())
    free |= {effect.group for effect in learnt_maps(found.identified.state.model)}
    terms = [term for term in ("geometry", "zeros", *kinds()) if term in free]
    return "+".join(terms) or "registration"
