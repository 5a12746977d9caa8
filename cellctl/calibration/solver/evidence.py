"""Whether rows are noisier than stated, or the robot further from nominal than its tolerances or prior model allow.

Both make the residuals large, and an estimate of only one of them is wrong twice: tolerances that are too tight push a
robot's true errors into the residuals; these are then taken for noise, which gives the tolerances more weight. Both
are weighed by the evidence of the linearised rows: the probability of what was measured, whatever the parameters are
(MacKay 1992, Bayesian interpolation, doi 10.1162/neco.1992.4.3.415; in geodesy: variance components by maximum
likelihood).

**Evidence.** Rows of kind k, linearised in their stated σ, are r_k + J_k x; φ_k is the factor on their noise, s_g the
factor on the prior of group g, C(s) the prior covariance. With x integrated out, up to a constant,

    ln p = −Σ_k n_k ln φ_k − ½ (ln|C| + ln|A| + rᵀr − Jᵀrᵀ A⁻¹ Jᵀr),
    A = JᵀJ + C⁻¹,  JᵀJ = Σ_k φ_k⁻² J_kᵀJ_k,  Jᵀr = Σ_k φ_k⁻² J_kᵀr_k,  rᵀr = Σ_k φ_k⁻² r_kᵀr_k,

n_k the count of numbers. The last two terms are χ² at the mode x̂ = −A⁻¹Jᵀr; ln|C| + ln|A| is the Occam factor, which
makes a wider prior cost something. So only JᵀJ, Jᵀr and rᵀr of each kind are kept, and factors are tried without the
rows.

**Slopes.** ∂ln p/∂ln φ_k = φ_k⁻² (‖r_k + J_k x̂‖² + tr(J_kᵀJ_k A⁻¹)) − n_k: at the optimum, squares are equal to the
redundancy of the kind, n_k − tr(φ_k⁻² J_kᵀJ_k A⁻¹). For independent priors with precision c = C⁻¹, ∂ln p/∂ln s_g = Σ_g
((x̂² + A⁻¹_ii) c_i − 1) for parameters whose whole variance scales (`change` is the part that does). L-BFGS-B climbs
in the logarithms.

**Model choice.** A factor of noise or tolerances other than 1 is a hypothesis: it is taken only if it raises ln p by
`SUPPORTED`, one after another, the most promising first. Sizes of effects are estimated always. All prior scales
have ln s ~ N(0, 1), except those of a prior model; so zeros × 17 cost ½ (ln 17)² = 4 nats besides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeAlias, final

import numpy as np
from scipy.linalg.lapack import dpotri

from cellctl.calibration.effects import kinds
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.unknowns import Unknowns
from cellctl.calibration.rows import Rows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.rows.type_rows import OF_TYPE, of_type
from cellctl.calibration.solver.estimate import Estimate, linearised, pins
from cellctl.kinematics import Bools, Floats

SUPPORTED = 4.0
"""Nats. A factor has to make the rows e⁴ = 55 times as probable ("strong" in Kass and Raftery 1995:
20 to 150). On clean rows no factor does. Of noise, which has no prior, it is a maximised likelihood ratio: 2 · 4 nats
on the bound of one parameter, p = ½ P(χ²(1) > 8) = 0.002 for each factor that is tried."""

UNEXPECTED = 2.5
"""χ² this many of its own standard deviations above its expectation is examined: χ²(ν) has the variance 2ν.
Of 100 clean sums 0.6 (large ν) to 3 (ν = 1) are. A false alarm only costs time: `SUPPORTED` decides."""

Factor: TypeAlias = tuple[str, int]
"""What may be larger than stated: ("noise", number in `RowBlocks.quantities`), (a group of parameters, 0), or
(`OF_TYPE`, 0), the spread of a type about its mean. Student's t is such a mixture of normal distributions."""

_NEVER_SCALED = ("points", "datums", "base")
"""Groups whose prior is flat, or stated by whoever measured the zero: there is nothing to widen."""

SCALE_SIGMA = 1.0
"""1 σ of the natural logarithm of a prior scale about 0, before the data: a stated size or tolerance is right within a
factor e, and one three times too small (1.1 σ) costs half a nat."""

FLAT_MM = 100.0
"""A prior σ from here on is flat: between those of tools (2 mm) and `Tolerances.flat_mm` (1000). A flat turn has σ 1
rad, and is found by the flat lengths of its group."""

LARGEST: Mapping[Group, float] = {"links": 20.0, "zeros": 100.0, "tool": 500.0}
"""Largest prior scale of the tolerances: links 10 mm off, joint zeros 5°, a tool a metre. Beyond it is no robot of this
file; without a bound, rows in which links hardly show themselves make a scale of thousands, and the links follow the
noise. Lost mastering has a flat prior instead (`--free zeros`). A prior model's σ is no tolerance: not bounded."""

UNBOUNDED = float(np.exp(12.0))
"""Of noise, and of a prior model's σ: only the search needs an end, e¹² = 160 000."""

FTOL = 1e-5
"""L-BFGS-B ends at a relative change of ln p below this: of some thousand nats 0.01, far below `SUPPORTED`."""


def unexpected(found: Estimate, rows: RowBlocks) -> bool:
    """Whether residuals or parameters of a fit are larger than noise and tolerances predict, in any kind or group."""
    state = found.state
    # (n − γ)/n, the mean redundancy number, for all kinds alike: this only decides whether the evidence is computed
    share = max(1.0 - found.effective_parameters / max(rows.size, 1), 1.0 / max(rows.size, 1))
    for block, _, _ in rows.parts():
        squares = (block.residual(state) / block.sigma) ** 2
        for quantity in dict.fromkeys(block.quantities):
            mine = squares[:, np.array(block.quantities) == quantity]
            if _beyond(float(mine.sum()), mine.size * share):
                return True
    return _unexpected_parameters(found)


def unlike_its_type(found: Estimate, others: Sequence[Rows]) -> bool:
    """Whether the robot is further from its type than the robots of the prior predict, if `others` have a type's
    rows.
    """
    squares = [(block.residual(found.state) / block.sigma) ** 2 for block in of_type(others)]
    return any(_beyond(float(each.sum()), each.size) for each in squares)


def _unexpected_parameters(found: Estimate) -> bool:
    """Whether parameters are further from their expected values than tolerances, or a prior model, predict.

    Cautious: at the mode E ‖x̂‖² is the group's share of γ, not its count, as the prior shrinks x̂. A group that the
    rows determine by half (24 links, s = 1) is noticed from a scale of 2.5 on, or else by its residuals.
    """
    unknowns, x = found.unknowns, found.deviations / found.unknowns.sigma
    groups, loose = np.array(unknowns.groups), scalable(unknowns)
    if unknowns.prior is not None:  # its errors are correlated between groups
        mine = unknowns.free & np.isin(groups, loose)
        return _beyond(float(np.sum((found.whitening @ x[unknowns.free]) ** 2)), int(mine.sum()))
    each = [unknowns.free & (groups == group) for group in loose if _prior_scales(group) is None]
    return any(_beyond(float(np.sum(x[mine] ** 2)), int(mine.sum())) for mine in each)


def scalable(unknowns: Unknowns) -> tuple[str, ...]:
    """Names (`Unknowns.scaled_with`) of parts of the prior that are scaled together: free, with a prior."""
    known = unknowns.free & (unknowns.sigma < FLAT_MM)
    names = unknowns.scaled_with
    there = dict.fromkeys(name for name, is_known in zip(names, known, strict=True) if is_known)
    flat = {name for name, is_flat in zip(names, unknowns.sigma >= FLAT_MM, strict=True) if is_flat}
    fixed = {*_NEVER_SCALED, *flat, *(group for group, kind in kinds().items() if kind.prior_scales is None)}
    return tuple(name for name in there if name not in fixed)


def estimated(unknowns: Unknowns) -> dict[str, tuple[float, float]]:
    """Those of `scalable` that belong to effects, with bounds of the scale: their size is estimated, not tested."""
    if unknowns.prior is not None:
        return {}
    free = (parameter for parameter, is_free in zip(unknowns.parameters, unknowns.free, strict=True) if is_free)
    return {each.scaled_with: bounds for each in free if (bounds := _prior_scales(each.group))}


def _prior_scales(group: Group) -> tuple[float, float] | None:
    kind = kinds().get(group)
    return kind.prior_scales if kind else None


def factors(found: Estimate, unknowns: Unknowns, rows: RowBlocks, certified: Sequence[Rows]) -> dict[Factor, float]:
    """Noise and prior scales by the evidence of `rows`, linearised at `found`: the most probable ones for effects
    (`tuned`); others one by one, only where the evidence supports them.
    """
    return System.of(unknowns, found.deviations, rows, certified).factors()


SLOPE_AT_LEAST = 2.0
"""Beside hundreds of amounts, a factor is not tried where the evidence rises more slowly than this with its log, nats
per factor of e: each trial is a search, with a Cholesky factor of all amounts at every step."""


@final
@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Linearised rows a + J x as normal equations, in tolerances: JᵀJ (F, F), Jtr = Jᵀa (F,), rtr = aᵀa, and the count
    of numbers. a: residuals at x = 0, where the unknowns are expected, not at the fit.
    """

    JtJ: Floats
    Jtr: Floats
    rtr: float
    count: int

    @classmethod
    def of(cls, columns: Floats, away: Floats) -> Self:
        """Of rows `away + columns @ x` (N, k), in standard deviations."""
        flat, residual = columns.reshape(away.size, columns.shape[-1]), away.reshape(-1)
        return cls(flat.T @ flat, flat.T @ residual, float(residual @ residual), residual.size)

    def restricted(self, at: Any) -> Self:
        """For the unknowns at `at` alone."""
        return replace(self, JtJ=self.JtJ[np.ix_(at, at)], Jtr=self.Jtr[at])

    def without(self, other: Self) -> Self:
        """Without the rows of `other`."""
        left = self.JtJ - other.JtJ, self.Jtr - other.Jtr, self.rtr - other.rtr
        return type(self)(*left, self.count - other.count)

    def slope(self, log: float, x: Floats, covariance: Floats) -> float:
        """Derivative of the evidence by the logarithm of these rows' noise, at optimum x with its covariance."""
        squares = self.rtr + 2.0 * self.Jtr @ x + x @ self.JtJ @ x
        return float(np.exp(-2.0 * log) * (squares + np.sum(self.JtJ * covariance)) - self.count)


@final
@dataclass(frozen=True, eq=False)
class System:
    """The linearised problem: rows by kind of number; fixed: rows that are never outliers, and pinned combinations.

    Its unknowns are the free and the considered ones of the fit: a prior model's uncertainty is not noise. groups
    (F,): index of each one's factor in `loose`, or −1. known (F, F): their prior covariance; change (F,): by how
    much each variance grows with its factor²; x (F,): the fit; all in tolerances. of_effects: factors that are
    estimated, with their bounds; closed: indices in `loose` without any unknown left.
    """

    numbers: Mapping[Factor, NormalEquations]
    fixed: tuple[NormalEquations, ...]
    loose: tuple[Factor, ...]
    groups: Any
    known: Floats
    change: Floats
    x: Floats
    of_effects: Mapping[Factor, tuple[float, float]] = field(default_factory=dict)
    closed: frozenset[int] = frozenset()
    independent: bool = False

    @classmethod
    def of(cls, unknowns: Unknowns, deviations: Floats, rows: RowBlocks, certified: Sequence[Rows]) -> Self:
        """The problem of `unknowns` linearised at `deviations` (P,) from their start."""
        about = np.flatnonzero(unknowns.free | unknowns.considered)
        scale = unknowns.sigma[about]
        state, x = unknowns.state(deviations), deviations[about] / scale

        def of(block: Rows) -> tuple[Floats, Floats]:
            columns, away = linearised(block, state, about, scale)
            return columns, away - columns @ x

        numbers: dict[Factor, NormalEquations] = {}
        for block, _, own in rows.parts():
            columns, away = of(block)
            for quantity in dict.fromkeys(block.quantities if len(block) else ()):
                mine = np.array(block.quantities) == quantity
                numbers["noise", own.start + int(np.argmax(mine))] = NormalEquations.of(columns[:, mine], away[:, mine])
        for told in of_type(certified):
            numbers[OF_TYPE, 0] = NormalEquations.of(*of(told))
        certified = [block for block in certified if not of_type([block])]
        loose = tuple(group for group in scalable(unknowns) if group != "links" or _measures_length(rows, certified))
        place, names = {name: number for number, name in enumerate(loose)}, unknowns.scaled_with
        return cls(
            numbers=numbers,
            fixed=(*(NormalEquations.of(*of(block)) for block in certified), _pins(unknowns, about)),
            loose=tuple((name, 0) for name in loose),
            of_effects={(name, 0): bounds for name, bounds in estimated(unknowns).items()},
            groups=np.array([place.get(names[at], -1) if unknowns.free[at] else -1 for at in about]),
            known=unknowns.known(about),
            change=unknowns.change[about],
            x=x,
            independent=unknowns.prior is None,
        )

    @property
    def possible(self) -> tuple[Factor, ...]:
        """All factors that may be larger than stated."""
        return (*self.numbers, *self.loose)

    def restricted(self, kept: Bools) -> Self:
        """The same problem with the unknowns at `kept` (F,) alone; the others have exactly their expected values."""
        at = np.flatnonzero(kept)
        of_kept = set(self.groups[at].tolist())
        return replace(
            self,
            numbers={factor: normal.restricted(at) for factor, normal in self.numbers.items()},
            fixed=tuple(normal.restricted(at) for normal in self.fixed),
            closed=frozenset(place for place in range(len(self.loose)) if place not in of_kept) | self.closed,
            groups=self.groups[at],
            known=self.known[np.ix_(at, at)],
            change=self.change[at],
            x=self.x[at],
        )

    def factors(self) -> dict[Factor, float]:
        """Noise and prior scales that are not 1."""
        tuned, _ = self.tuned()
        # at its bound a logarithm is 0 within the rounding of the search
        return {factor: float(np.exp(value)) for factor, value in tuned.items() if abs(value) > 1e-6}

    def tuned(self, begin: Mapping[Factor, float] | None = None) -> tuple[dict[Factor, float], float]:
        """Logarithms of noise and prior scales, and the evidence with them; begin: start values."""
        known = begin or {}
        chosen = {factor: value for factor, value in known.items() if factor in self._open}
        if self._estimated:
            chosen |= {name: known.get(name, 0.0) for name in self._estimated}
            _, chosen = self._tuned(chosen, tuple(factor for factor in self.numbers if factor not in chosen))
        else:
            chosen = {}
        best, slopes = self.evidence(chosen)
        least = SLOPE_AT_LEAST if self._estimated else 0.0
        while True:
            promising = [factor for factor in self._open if factor not in chosen and slopes[factor] > least]
            wider = [self._tuned(chosen, (factor,)) for factor in promising]
            evidence, tried = max(wider, key=lambda pair: pair[0], default=(-np.inf, chosen))
            if evidence - best < SUPPORTED:
                return chosen, best
            chosen = {factor: value for factor, value in tried.items() if factor in self._estimated or value > 1e-6}
            best, slopes = self.evidence(chosen)

    def gain(self, factor: Factor, logs: Mapping[Factor, float]) -> tuple[float, dict[Factor, float]]:
        """Rise of the evidence by `factor`, compared with its least scale; and all logarithms then. Except for it and
        for noise that is larger than stated, they stay as in `logs`.
        """
        without = {**logs, factor: float(np.log(self.of_effects[factor][0]))}
        noise = {name: value for name, value in logs.items() if name in self.numbers and value > 0.0}
        fixed = {name: value for name, value in logs.items() if name not in noise}
        best, tuned = self._tuned({**noise, factor: 0.0}, (), fixed)
        # `evidence` subtracts the log-normal prior of so small a scale. It means "no effect" here: that is taken back
        unlikely = 0.5 * (without[factor] / SCALE_SIGMA) ** 2
        return best - self.evidence(without)[0] - unlikely, {**fixed, **tuned}

    @property
    def _open(self) -> list[Factor]:
        closed = {self.loose[place] for place in self.closed}
        return [factor for factor in self.possible if factor not in closed]

    @property
    def _estimated(self) -> list[Factor]:
        return [factor for factor in self._open if factor in self.of_effects]

    def _tuned(
        self, chosen: Mapping[Factor, float], more: tuple[Factor, ...], fixed: Mapping[Factor, float] | None = None
    ) -> tuple[float, dict[Factor, float]]:
        """Greatest evidence with the factors `more` added to those chosen, and all their logarithms then."""
        from scipy.optimize import minimize  # at first use: it takes 0.2 s

        names = [*chosen, *more]

        def negative_log_evidence(logs: Floats) -> tuple[float, Floats]:
            value, slopes = self.evidence({**(fixed or {}), **dict(zip(names, logs.tolist(), strict=True))})
            return -value, -np.array([slopes[name] for name in names])

        start = np.array([*chosen.values(), *(self.guess(factor) for factor in more)])
        bounds = [tuple(np.log(self._bounds(name)).tolist()) for name in names]
        found = minimize(
            negative_log_evidence, start, jac=True, bounds=bounds, method="L-BFGS-B", options={"ftol": FTOL}
        )
        return -float(found.fun), dict(zip(names, found.x.tolist(), strict=True))

    def _bounds(self, factor: Factor) -> tuple[float, float]:
        """Least and greatest value of a factor."""
        group, _ = factor
        return self.of_effects.get(factor, (1.0, LARGEST.get(group, UNBOUNDED) if self.independent else UNBOUNDED))

    def guess(self, factor: Factor) -> float:
        """Start value of a factor's logarithm: how much larger than predicted residuals, or parameters, are.

        At least 0.3, a factor of 1.35: the search begins off its lower bound 1, where a small slope would end it.
        """
        if factor in self.numbers:
            normal = self.numbers[factor]
            squares = normal.rtr + 2.0 * normal.Jtr @ self.x + self.x @ normal.JtJ @ self.x
            return max(0.5 * float(np.log(max(float(squares) / normal.count, 1.0))), 0.3)
        mine = self.groups == self.loose.index(factor)
        return max(0.5 * float(np.log(max(float(np.mean(self.x[mine] ** 2 / self.change[mine])), 1.0))), 0.3)

    def evidence(self, logs: Mapping[Factor, float]) -> tuple[float, dict[Factor, float]]:
        """Logarithm of the probability of the rows with these logarithms of factors, up to a constant; and its
        derivative by the logarithm of each possible factor.
        """
        JtJ, Jtr, rtr, value = self._weighed(logs)
        tolerances = self._scales(logs)
        known, before = self._known_with(tolerances)
        covariance, volume = _inverse(JtJ + known)
        x = -covariance @ Jtr
        value += -0.5 * float(before + rtr + Jtr @ x + volume)
        slopes = {factor: normal.slope(logs.get(factor, 0.0), x, covariance) for factor, normal in self.numbers.items()}
        if self.independent:
            widened = (x**2 + np.diag(covariance)) * np.diag(known) ** 2 - np.diag(known)
        else:
            widened = np.diag(known @ (np.outer(x, x) + covariance) @ known - known)
        own = np.exp(2.0 * tolerances) * self.change * widened
        slopes.update({factor: float(own[self.groups == place].sum()) for place, factor in enumerate(self.loose)})
        penalised = self.loose if self.independent else tuple(self.of_effects)
        for factor in [each for each in penalised if each in logs]:  # not a set's order: sums depend on it
            value -= 0.5 * (logs[factor] / SCALE_SIGMA) ** 2
            slopes[factor] -= logs[factor] / SCALE_SIGMA**2
        return float(value), slopes

    def posterior(self, logs: Mapping[Factor, float]) -> tuple[Floats, Floats]:
        """Inverse covariance (F, F) of the unknowns with these logarithms, and the gradient (F,)."""
        JtJ, Jtr, _, _ = self._weighed(logs)
        return JtJ + self._known_with(self._scales(logs))[0], Jtr

    def _weighed(self, logs: Mapping[Factor, float]) -> tuple[Floats, Floats, float, float]:
        certified = [(normal, 0.0) for normal in self.fixed]
        weighed = [*certified, *((normal, logs.get(factor, 0.0)) for factor, normal in self.numbers.items())]
        JtJ, Jtr, rtr, value = np.zeros_like(self.known), np.zeros_like(self.x), 0.0, 0.0
        for normal, log in weighed:
            weight = float(np.exp(-2.0 * log))
            JtJ, Jtr = JtJ + weight * normal.JtJ, Jtr + weight * normal.Jtr
            rtr, value = rtr + weight * normal.rtr, value - normal.count * log
        return JtJ, Jtr, rtr, value

    def _scales(self, logs: Mapping[Factor, float]) -> Floats:
        """The logarithm of the prior scale of each unknown (F,)."""
        return np.asarray(np.array([*(logs.get(factor, 0.0) for factor in self.loose), 0.0])[self.groups])

    def _known_with(self, logs: Floats) -> tuple[Floats, float]:
        """Inverse of the prior covariance with these logarithms (F,) of its scales, and the log of its determinant."""
        if self.independent:
            return np.diag(np.exp(-2.0 * logs)), float(2.0 * logs.sum())
        return _inverse(self.known + np.diag(self.change * np.expm1(2.0 * logs)))


def _pins(unknowns: Unknowns, about: Any) -> NormalEquations:
    """Pinned combinations, as in the estimate, for the unknowns at `about` (F,)."""
    pinned = pins(unknowns, about)
    return NormalEquations.of(pinned, np.zeros(len(pinned)))


def _inverse(square: Floats) -> tuple[Floats, float]:
    """Inverse of a positive definite matrix (F, F), whose unknowns may differ a million times in precision, and the
    logarithm of its determinant. Scaled to a unit diagonal first, which is within a factor F of the scaling with the
    best condition (van der Sluis 1969).
    """
    scale = 1.0 / np.sqrt(np.diag(square))
    root = _root(square * scale * scale[:, None])
    inverse, _ = dpotri(root, lower=1)
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    volume = 2.0 * np.log(np.diag(root)).sum() - 2.0 * np.log(scale).sum()
    return inverse * scale * scale[:, None], float(volume)


def _root(square: Floats) -> Floats:
    """Cholesky factor (F, F); where rounding leaves none (tolerance far too wide), of the nearest that has one."""
    try:
        root = np.linalg.cholesky(square)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(square)
        least = 2.0 * np.finfo(float).eps * len(values) * float(values[-1])
        root = np.linalg.cholesky((vectors * np.maximum(values, least)) @ vectors.T + 0.5 * least * np.eye(len(values)))
    return np.asarray(root, float)


def _measures_length(rows: RowBlocks, certified: Sequence[Rows]) -> bool:
    """Whether any row measures a length. Sockets and planes alone do not: a robot of size 0 would fit all of them at
    once, and only the tolerances of its links prevent that.
    """
    return any(map(len, certified)) or any(len(block) and block.has_length for block in rows.blocks)


def _beyond(squares: float, count: float) -> bool:
    return squares > count + UNEXPECTED * float(np.sqrt(2.0 * count))
