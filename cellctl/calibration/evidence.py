"""Whether rows are noisier than they say, or the robot is further from nominal than its tolerances say, or from an
older model than that was sure of.

Both make the residuals large, and who takes the one for the other is wrong twice: tolerances that are too tight push a
robot's true errors into the residuals, which then look like noise, which makes the tolerances weigh more. So both are
weighed by the evidence of the linearised rows: the probability of what was measured, whatever the parameters are. A
factor greater than 1 on the noise of a kind of number, or on the tolerances of a group, is taken only if it makes the
rows much more probable (MacKay 1992, Bayesian interpolation, doi 10.1162/neco.1992.4.3.415).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.estimate import Estimate, linearised, pins
from cellctl.calibration.mixture import Mixture
from cellctl.calibration.rows import PlaneRows, Rows, SocketRows
from cellctl.calibration.unknowns import Unknowns
from cellctl.kinematics import Floats

PAYS = 4.0
"""A factor has to raise the logarithm of the evidence by this: 55 times as probable. On clean rows none does."""

UNEXPECTED = 2.5
"""χ² this many of its own standard deviations above what it should be is looked into."""

Factor: TypeAlias = tuple[str, int]
"""What may be larger than said: ("noise", number in `Mixture.quantities`) or (a group of parameters, 0)."""

_NEVER_LOOSENED = ("points", "datums", "base", "deflection")


def unexpected(found: Estimate, rows: Mixture) -> bool:
    """Whether residuals or parameters of a fit are larger than noise and tolerances say, for any kind or group."""
    state = found.state
    share = max(1.0 - found.seen_by_data / max(rows.size, 1), 1.0 / max(rows.size, 1))
    for block, _, _ in rows.parts():
        squares = (block.residual(state) / block.sigma) ** 2
        for quantity in dict.fromkeys(block.quantities):
            mine = squares[:, np.array(block.quantities) == quantity]
            if _beyond(float(mine.sum()), mine.size * share):
                return True
    return _strange(found)


def _strange(found: Estimate) -> bool:
    """Whether parameters are further from where they were expected than tolerances, or an older model, say."""
    unknowns, x = found.unknowns, found.deviations / found.unknowns.sigma
    groups, loose = np.array(unknowns.groups), loosenable(unknowns)
    if unknowns.prior is not None:  # its errors of one group are those of the others, too
        mine = unknowns.free & np.isin(groups, loose)
        return _beyond(float(np.sum((found.whitening @ x[unknowns.free]) ** 2)), int(mine.sum()))
    each = [unknowns.free & (groups == group) for group in loose]
    return any(_beyond(float(np.sum(x[mine] ** 2)), int(mine.sum())) for mine in each)


def loosenable(unknowns: Unknowns) -> tuple[str, ...]:
    """Groups whose tolerances may be too tight, or of which an older model may be too sure: free ones of which
    something was known.
    """
    known = unknowns.free & (unknowns.sigma < 100.0)  # what is registered to an instrument was not known at all
    there = dict.fromkeys(group for group, is_known in zip(unknowns.groups, known, strict=True) if is_known)
    flat = {group for group, is_flat in zip(unknowns.groups, unknowns.sigma >= 100.0, strict=True) if is_flat}
    return tuple(group for group in there if group not in _NEVER_LOOSENED and group not in flat)


def factors(found: Estimate, unknowns: Unknowns, rows: Mixture, certain: Sequence[Rows]) -> dict[Factor, float]:
    """By how much noise and tolerances are larger than `rows` and `unknowns` say, linearised at `found`; only factors
    that the evidence pays for, one after another.
    """
    system = _System.of(found, unknowns, rows, certain)
    chosen: dict[Factor, float] = {}
    best, slopes = system.evidence(chosen)
    while True:
        promising = [factor for factor in system.possible if factor not in chosen and slopes[factor] > 0.0]
        wider = [_tuned(system, chosen, factor) for factor in promising]
        evidence, tuned = max(wider, key=lambda pair: pair[0], default=(-np.inf, chosen))
        if evidence - best < PAYS:
            return {factor: float(np.exp(value)) for factor, value in chosen.items()}
        chosen = {factor: value for factor, value in tuned.items() if value > 1e-6}
        best, slopes = system.evidence(chosen)


def _tuned(system: _System, chosen: Mapping[Factor, float], factor: Factor) -> tuple[float, dict[Factor, float]]:
    """Greatest evidence with `factor` beside those chosen, and their logarithms then."""
    from scipy.optimize import minimize

    names = [*chosen, factor]

    def improbable(logs: Floats) -> tuple[float, Floats]:
        value, slopes = system.evidence(dict(zip(names, logs.tolist(), strict=True)))
        return -value, -np.array([slopes[name] for name in names])

    start = np.array([*chosen.values(), system.guess(factor)])
    found = minimize(improbable, start, jac=True, bounds=[(0.0, 12.0)] * len(names), method="L-BFGS-B")
    return -float(found.fun), dict(zip(names, found.x.tolist(), strict=True))


@final
@dataclass(frozen=True, eq=False)
class _Normal:
    """Linearised rows as normal equations, in tolerances: JᵀJ (F, F), Jᵀa (F,), aᵀa, and how many numbers."""

    square: Floats
    pull: Floats
    rest: float
    count: int

    @classmethod
    def of(cls, columns: Floats, away: Floats) -> Self:
        flat, residual = columns.reshape(away.size, columns.shape[-1]), away.reshape(-1)
        return cls(flat.T @ flat, flat.T @ residual, float(residual @ residual), residual.size)

    def slope(self, log: float, x: Floats, covariance: Floats) -> float:
        """How fast the evidence rises with the logarithm of these rows' noise, at the optimum x and its covariance."""
        squares = self.rest + 2.0 * self.pull @ x + x @ self.square @ x
        return float(np.exp(-2.0 * log) * (squares + np.sum(self.square * covariance)) - self.count)


@final
@dataclass(frozen=True, eq=False)
class _System:
    """The linearised problem: rows by kind of number; fixed: rows that are never in doubt, and what is pinned.

    Its unknowns are those of the fit and what is held but doubted: what an older model did not know is no noise. groups
    (F,): for each its factor's place in `loose`, or −1. known (F, F): their covariance beforehand; change (F,): by how
    much each variance grows with its factor²; x (F,): where the fit is; all in tolerances.
    """

    numbers: Mapping[Factor, _Normal]
    fixed: tuple[_Normal, ...]
    loose: tuple[Factor, ...]
    groups: Any
    known: Floats
    change: Floats
    x: Floats

    @classmethod
    def of(cls, found: Estimate, unknowns: Unknowns, rows: Mixture, certain: Sequence[Rows]) -> Self:
        about = np.flatnonzero(unknowns.free | unknowns.doubted)
        scale = unknowns.sigma[about]
        state, x = found.state, found.deviations[about] / scale

        def of(block: Rows) -> tuple[Floats, Floats]:
            columns, away = linearised(block, state, about, scale)
            return columns, away - columns @ x

        numbers: dict[Factor, _Normal] = {}
        for block, _, own in rows.parts():
            columns, away = of(block)
            for quantity in dict.fromkeys(block.quantities if len(block) else ()):
                mine = np.array(block.quantities) == quantity
                numbers["noise", own.start + int(np.argmax(mine))] = _Normal.of(columns[:, mine], away[:, mine])
        loose = tuple(group for group in loosenable(unknowns) if group != "links" or _measures_length(rows, certain))
        place = {group: number for number, group in enumerate(loose)}
        return cls(
            numbers=numbers,
            fixed=(*(_Normal.of(*of(block)) for block in certain), _pins(unknowns, about)),
            loose=tuple((group, 0) for group in loose),
            groups=np.array([place.get(unknowns.groups[at], -1) if unknowns.free[at] else -1 for at in about]),
            known=unknowns.known(about),
            change=unknowns.change[about],
            x=x,
        )

    @property
    def possible(self) -> tuple[Factor, ...]:
        """Everything that may be larger than said."""
        return (*self.numbers, *self.loose)

    def guess(self, factor: Factor) -> float:
        """Logarithm of a factor to begin with: by how much residuals, or parameters, are larger than they should be."""
        if factor in self.numbers:
            normal = self.numbers[factor]
            squares = normal.rest + 2.0 * normal.pull @ self.x + self.x @ normal.square @ self.x
            return max(0.5 * float(np.log(max(float(squares) / normal.count, 1.0))), 0.3)
        mine = self.groups == self.loose.index(factor)
        return max(0.5 * float(np.log(max(float(np.mean(self.x[mine] ** 2 / self.change[mine])), 1.0))), 0.3)

    def evidence(self, logs: Mapping[Factor, float]) -> tuple[float, dict[Factor, float]]:
        """Logarithm of the probability of the rows with these factors' logarithms, but for a constant; and how fast it
        rises with each possible factor's.
        """
        certain = [(normal, 0.0) for normal in self.fixed]
        weighed = [*certain, *((normal, logs.get(factor, 0.0)) for factor, normal in self.numbers.items())]
        square, pull, rest, value = np.zeros_like(self.known), np.zeros_like(self.x), 0.0, 0.0
        for normal, log in weighed:
            weight = float(np.exp(-2.0 * log))
            square, pull = square + weight * normal.square, pull + weight * normal.pull
            rest, value = rest + weight * normal.rest, value - normal.count * log
        tolerances = np.array([*(logs.get(factor, 0.0) for factor in self.loose), 0.0])[self.groups]
        known, before = _inverse(self.known + np.diag(self.change * np.expm1(2.0 * tolerances)))
        covariance, volume = _inverse(square + known)
        x = -covariance @ pull
        value += -0.5 * float(before + rest + pull @ x + volume)
        slopes = {factor: normal.slope(logs.get(factor, 0.0), x, covariance) for factor, normal in self.numbers.items()}
        widened = np.diag(known @ (np.outer(x, x) + covariance) @ known - known)
        own = np.exp(2.0 * tolerances) * self.change * widened
        slopes.update({factor: float(own[self.groups == place].sum()) for place, factor in enumerate(self.loose)})
        return float(value), slopes


def _pins(unknowns: Unknowns, about: Any) -> _Normal:
    """What stays where it starts, as the estimate has it, for the unknowns at `about` (F,)."""
    pinned = pins(unknowns, about)
    return _Normal.of(pinned, np.zeros(len(pinned)))


def _inverse(square: Floats) -> tuple[Floats, float]:
    """Inverse of a positive definite matrix (F, F) whose unknowns may be seen a million times better one than another,
    and the logarithm of its determinant.
    """
    scale = 1.0 / np.sqrt(np.diag(square))
    root = _root(square * scale * scale[:, None])
    half = np.linalg.solve(root, np.diag(scale))
    return half.T @ half, float(2.0 * np.log(np.diag(root)).sum() - 2.0 * np.log(scale).sum())


def _root(square: Floats) -> Floats:
    """Cholesky factor (F, F); where rounding leaves none, as of a tolerance far too wide, of the nearest that has."""
    try:
        root = np.linalg.cholesky(square)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(square)
        least = 2.0 * np.finfo(float).eps * len(values) * float(values[-1])
        root = np.linalg.cholesky((vectors * np.maximum(values, least)) @ vectors.T + 0.5 * least * np.eye(len(values)))
    return np.asarray(root, float)


def _measures_length(rows: Mixture, certain: Sequence[Rows]) -> bool:
    """Whether anything here is a length. Sockets and planes alone are not: a robot of no size would be in all of
    them at once, and nothing but the tolerances of its links keeps it from shrinking.
    """
    return any(map(len, certain)) or any(
        len(block) and not isinstance(block, SocketRows | PlaneRows) for block in rows.blocks
    )


def _beyond(squares: float, count: float) -> bool:
    return squares > count + UNEXPECTED * float(np.sqrt(2.0 * count))
