"""Which of many candidate rows to measure: an experiment designed for what it shall predict.

The gain of a row does not depend on its reading. With C the posterior covariance of the parameters (P, P) and a (k, P)
the Jacobian of a row in its standard deviations, measuring it makes

    C' = C − Caᵀ (I + aCaᵀ)⁻¹ aC ,        and leaving it out again    C = C' + C'aᵀ (I − aC'aᵀ)⁻¹ aC'

(Sherman, Morrison, Woodbury). With J_n (3, P) the derivative of the n-th place of the task by the parameters, a design
is the better, the smaller

    volume  (1/N) Σ_n tr(J_n C J_nᵀ)      mean variance over the task: I-optimal, also called V-optimal
    max     max_n tr(J_n C J_nᵀ)          largest variance over the task
    D       log det(S⁻¹ C S⁻¹)            volume of the parameters' confidence ellipsoid
    A       tr(S⁻¹ C S⁻¹)                 variances of the parameters
    G       max_m tr(a_m C a_mᵀ)          largest variance over the candidates, in their own σ

S: prior σ of the parameters; without it A would add millimetres to radians. D, A and G spend rows on parameters that
the task does not need; `volume` and `max` do not (Fedorov 1972, Theory of optimal experiments; Atkinson, Donev and
Tobias 2007, Optimum experimental designs, ch. 10 and 12).

Fedorov's exchange: from rows spread evenly, each row in turn gives way to the candidate that is best beside all the
others, until no exchange is better. Chosen one by one instead, the first rows would be chosen for a registration of
which nothing was known (prior 1 m), and the products lose their digits there. What a candidate's gain depends on is
not computed anew after each exchange: it changes by a product of rank k (`Design.exchange`).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Literal, Self, TypeAlias, final, get_args

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import Bools, Floats

Criterion: TypeAlias = Literal["volume", "max", "D", "A", "G"]
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)

PASSES = 8
"""Exchange passes at most; most designs end before."""

TRIED = 10
"""Candidates tried in a pass for each row that is chosen."""

LARGEST_OF = 64
"""Places among which `max` and `G` look for the largest variance: products with all candidates are kept."""

_UNSEEN = 0.1
"""Information on a direction, in units of its prior's, below which it counts as not measured: its σ falls by 5 %."""

_BETTER = 1e-4
"""A share of a gain by which an exchange has to be better: single precision must not exchange for ever."""

_NEGLIGIBLE = 1e-3
"""Share of the mean variance over the task that the exchange may overlook: it takes a third of the directions."""

CHECKED_RISE = 0.3
"""A row is checked by the others where the predicted error rises by no more than this share without it."""

_SPARED = 6
"""Rows that are tried as the one to be given up for a row that checks another."""


@final
class Design:
    """Candidates and what is known after the rows chosen so far. Criteria are costs: smaller is better.

    covariance (P, P): before any row, in the parameters' units. candidates (M, k, P): Jacobians in standard deviations,
    filled up with zeros where a row has fewer than k numbers; in single precision, so are the gains. asked (3 N, P):
    derivative of the task's places by the parameters, mm. left (N,): variance of each place, mm², that no row changes.
    units (P,): prior σ of the parameters, for A; default 1. negligible: share of the mean variance over the task that
    `volume` leaves out, where the covariance of the parameters is about 1.
    """

    def __init__(
        self,
        covariance: Floats,
        candidates: Floats,
        asked: Floats,
        criterion: Criterion = "volume",
        left: Floats | None = None,
        *,
        units: Floats | None = None,
        negligible: float = 0.0,
    ) -> None:
        self.covariance, self._candidates, self._criterion = covariance, candidates, criterion
        self._flat = np.ascontiguousarray(candidates.reshape(-1, candidates.shape[2]))
        self._towards = _towards(criterion, candidates, asked, units, negligible)
        self._left = np.zeros(1) if left is None or criterion == "G" else left
        self._left = self._left[_some(len(self._left))] if criterion == "max" and left is not None else self._left
        # what `gains` needs of each candidate a: aCaᵀ, and aCR, RRᵀ the weight of the parameters, or R of all places
        carried = self._flat @ covariance.astype(candidates.dtype)
        self._spread = np.matmul(carried.reshape(candidates.shape), np.swapaxes(candidates, 1, 2))
        towards = self._towards.astype(candidates.dtype)
        self._crossed = (carried @ towards).reshape(*candidates.shape[:2], towards.shape[1])
        self._variances = np.sum((covariance @ self._towards) * self._towards, axis=0)

    def among(self, some: NDArray[np.int_]) -> Self:
        """The same with these candidates alone, in this order."""
        fewer = copy(self)
        fewer._candidates, fewer._spread, fewer._crossed = (
            self._candidates[some],
            self._spread[some],
            self._crossed[some],
        )
        fewer._flat = np.ascontiguousarray(fewer._candidates.reshape(-1, len(self.covariance)))
        return fewer

    def gains(self) -> Floats:
        """By how much each candidate (M,) alone would lower the criterion."""
        system = np.eye(self._spread.shape[1], dtype=self._spread.dtype) + self._spread
        if self._criterion == "D":
            return np.asarray(np.linalg.slogdet(system)[1])
        if self._criterion in ("volume", "A"):
            return _trace_of_quotient(system, self._crossed)
        # R C aᵀ (I + aCaᵀ)⁻¹ a C Rᵀ of each place: |L⁻¹ a C Rᵀ|², L Lᵀ = I + aCaᵀ
        lowered = np.linalg.solve(np.linalg.cholesky(system), self._crossed) ** 2
        each = self._candidates.shape[1] if self._criterion == "G" else 3
        variance = self._left + self._variances.reshape(-1, each).sum(axis=1)
        after = variance - lowered.sum(axis=1).reshape(len(lowered), -1, each).sum(axis=2)
        return np.asarray(variance.max() - after.max(axis=1))

    def measure(self, row: int) -> None:
        """Take candidate `row` as measured."""
        self.exchange((), (row,))

    def leave_out(self, row: int) -> None:
        """Take candidate `row`, which was measured, as not measured."""
        self.exchange((row,), ())

    def exchange(self, out: Sequence[int], into: Sequence[int]) -> None:
        """Take the candidates `out`, which were measured, as not measured, and those `into` as measured."""
        gain, middle = self._change(out, into)
        after = self.covariance - gain @ middle @ gain.T
        self.covariance = (after + after.T) / 2.0

    def gains_without(self, row: int) -> Floats:
        """`gains` with candidate `row`, which was measured, left out."""
        other = copy(self)
        other._change((row,), ())
        return other.gains()

    def rises(self, rows: Sequence[int]) -> Floats:
        """Share (K,) by which the RMS error over the task rises without one of `rows`, all measured: `volume`.

        0 where the task has no extent (one posture): rigid motion removed, nothing is predicted.
        """
        if self.variance <= 0.0:
            return np.zeros(len(rows))
        # anew, in double precision: I − aCaᵀ of a row that no other checks is below what single precision keeps
        a = self._candidates[list(rows)].astype(float)
        carried = a @ self.covariance
        spread, crossed = carried @ np.swapaxes(a, 1, 2), carried @ self._towards
        more = _trace_of_quotient(np.eye(spread.shape[1]) - spread, crossed)
        return np.asarray(np.sqrt(1.0 + more / self.variance) - 1.0)

    def leverage(self, rows: Sequence[int]) -> Floats:
        """aCaᵀ (K,), summed over the numbers of each of `rows`, which were measured."""
        return np.asarray(np.trace(self._spread[list(rows)].astype(float), axis1=1, axis2=2))

    @property
    def variance(self) -> float:
        """Mean over the task, mm²: `volume`."""
        return float(self._left.mean() + self._variances.sum())

    def _change(self, out: Sequence[int], into: Sequence[int]) -> tuple[Floats, Floats]:
        """With b all these rows, S = ±1, G = Cbᵀ and K = (S + bCbᵀ)⁻¹: C' = C − GKGᵀ, so that of a candidate a, with
        t = aG: aC'aᵀ = aCaᵀ − tKtᵀ and aC'R = aCR − tKGᵀR. Gives G and K; the covariance is not changed yet.
        """
        rows, count = [*out, *into], self._candidates.shape[1]
        b = self._candidates[rows].reshape(-1, len(self.covariance)).astype(float)
        gain = self.covariance @ b.T
        signs = np.repeat([-1.0] * len(out) + [1.0] * len(into), count)
        middle = np.linalg.inv(np.diag(signs) + b @ gain)
        t = self._flat @ gain.astype(self._flat.dtype)
        along, turned = gain.T @ self._towards, t @ middle.astype(t.dtype)
        tall = (len(self._candidates), count, len(b))
        self._spread = self._spread - np.matmul(turned.reshape(tall), np.swapaxes(t.reshape(tall), 1, 2))
        self._crossed = self._crossed - (turned @ along.astype(t.dtype)).reshape(self._crossed.shape)
        self._variances = self._variances - np.sum((middle @ along) * along, axis=0)
        return gain, middle


def _trace_of_quotient(system: Floats, crossed: Floats) -> Floats:
    """tr(system⁻¹ crossed crossedᵀ) (M,) of each candidate."""
    square = np.matmul(crossed, np.swapaxes(crossed, 1, 2))
    if system.shape[1] == 1:
        return np.asarray((square / system)[:, 0, 0])
    return np.asarray(np.trace(np.linalg.solve(system, square), axis1=1, axis2=2))


def _towards(
    criterion: Criterion, candidates: Floats, asked: Floats, units: Floats | None, negligible: float
) -> Floats:
    """R (P, r): the criterion is the sum of the variances of Rᵀ times the parameters, or the largest of places, each
    with 3 or k columns; none for D.
    """
    if criterion == "A":
        return np.diag(np.ones(asked.shape[1]) if units is None else 1.0 / units)
    if criterion in ("max", "G"):
        places = candidates if criterion == "G" else asked.reshape(-1, 3, asked.shape[1])
        return np.asarray(places[_some(len(places))].reshape(-1, asked.shape[1]).T.astype(float))
    if criterion == "D":
        return np.zeros((asked.shape[1], 0))
    if not negligible and len(asked) <= asked.shape[1]:
        return np.asarray(asked.T / np.sqrt(len(asked) / 3.0))
    values, vectors = np.linalg.eigh(asked.T @ asked / (len(asked) / 3.0))
    kept = np.cumsum(values) > negligible * values.sum()
    return np.asarray(vectors[:, kept] * np.sqrt(np.maximum(values[kept], 0.0)))


def _some(count: int) -> NDArray[np.int_]:
    return np.unique(np.linspace(0, count - 1, min(count, LARGEST_OF)).astype(int))


@final
@dataclass(frozen=True, eq=False)
class _Condensed:
    """Candidates (M, k, R) in their standard deviations, in single precision; places (3 N, R), mm; information (R,)
    before any row. The parameters are in units of their σ after average rows. left (N,): variance of each place, mm²,
    by the other parameters, which no choice of rows changes.
    """

    candidates: NDArray[Any]
    asked: Floats
    known: Floats
    left: Floats

    def after(self, chosen: Sequence[int]) -> Floats:
        """The covariance (R, R) after the candidates `chosen`."""
        rows = np.concatenate(self.candidates[list(chosen)]).astype(float)
        return np.asarray(np.linalg.inv(np.diag(self.known) + rows.T @ rows))

    def design(self, chosen: Sequence[int], criterion: Criterion = "volume") -> Design:
        """All candidates after those that are chosen."""
        units = 1.0 / np.sqrt(self.known)
        return Design(
            self.after(chosen), self.candidates, self.asked, criterion, self.left, units=units, negligible=_NEGLIGIBLE
        )  # fmt: skip

    def variances(self, covariance: Floats) -> Floats:
        """tr(J C Jᵀ) (N,), mm², of the places."""
        return np.asarray(self.left + np.sum((self.asked @ covariance) * self.asked, axis=1).reshape(-1, 3).sum(axis=1))


def condensed(covariance: Floats, candidates: Floats, asked: Floats, count: int) -> _Condensed:
    """The same problem with as few parameters as `count` rows can tell apart.

    With C = SSᵀ the candidates in units of the prior are AS; the eigenvectors u of SᵀAᵀAS have λ, the sum over all
    candidates of the information along u. `count` average rows bring λ count / M of it, against the 1 of the prior:
    where that is below `_UNSEEN` the direction keeps its prior, whatever is chosen. Effects with hundreds of amounts
    (harmonics, a discrepancy) are mostly such directions. The others are in units of their σ after average rows,
    1/√(1 + λ count / M): all numbers are then about 1, and single precision is enough for products with candidates.
    """
    root = _root(covariance)
    rows = _times(candidates.reshape(-1, len(covariance)), root)
    information, directions = np.linalg.eigh(rows.T @ rows)
    information = np.maximum(information, 0.0) * count / len(candidates)
    seen = information > _UNSEEN
    places = _times(asked, root)
    left = np.sum((places @ directions[:, ~seen]) ** 2, axis=1).reshape(-1, 3).sum(axis=1)
    sigma = 1.0 / np.sqrt(1.0 + information[seen])
    kept = directions[:, seen] * sigma
    flat = (rows @ kept).astype(np.float32)
    return _Condensed(flat.reshape(*candidates.shape[:2], -1), places @ kept, sigma**2, left)


def _root(covariance: Floats) -> Floats:
    """S (P,) or (P, P) with SSᵀ = C, of a covariance that may be singular (parameters that are held)."""
    if not (covariance - np.diag(np.diag(covariance))).any():
        return np.asarray(np.sqrt(np.diag(covariance)))
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _times(rows: Floats, root: Floats) -> Floats:
    return np.asarray(rows * root if root.ndim == 1 else rows @ root)


def updated(covariance: Floats, row: Floats, sign: float = 1.0) -> Floats:
    """The covariance (P, P) after a measurement with Jacobian `row` (k, P), in its standard deviations; −1: without."""
    after = covariance - sign * (row @ covariance).T @ answer(covariance, row, sign)
    return np.asarray((after + after.T) / 2.0)


def answer(covariance: Floats, row: Floats, sign: float = 1.0) -> Floats:
    """(1 ± aCaᵀ)⁻¹aC (k, P) of `row` a (k, P)."""
    carried = row @ covariance
    return np.asarray(np.linalg.solve(np.eye(len(row)) + sign * carried @ row.T, carried))


@final
@dataclass(frozen=True, eq=False)
class Chosen:
    """A design. rows (K,): indices of candidates; exchanged: number of exchanges.

    sigma_mm, largest_mm: 1 σ, 3-D, RMS and largest over the task; even_…: after as many rows drawn evenly from the
    candidates. rises (K,): share by which the RMS rises without each of the rows, and leverage (K,): share of a row's
    numbers that the fit takes from itself (1: no other row checks it), both of a model of the `core` alone.
    """

    rows: tuple[int, ...]
    exchanged: int
    sigma_mm: float
    largest_mm: float
    even_sigma_mm: float
    even_largest_mm: float
    rises: Floats
    leverage: Floats


def chosen_rows(
    covariance: Floats,
    candidates: Floats,
    asked: Floats,
    count: int,
    criterion: Criterion = "volume",
    *,
    core: Bools | None = None,
    most_rise: float | None = None,
) -> Chosen:
    """The `count` of `candidates` that are best by `criterion`; for the arguments see `Design`.

    core (P,): parameters that the model has for certain, default: all. most_rise: share by which the RMS error over the
    task may rise without any one row, by a model of these alone: rows are exchanged until it rises by no more, or no
    exchange lowers it. None: no limit.
    """
    count = min(count, len(candidates))
    whole = condensed(covariance, candidates, asked, count)
    evenly: list[int] = np.linspace(0, len(candidates) - 1, count).astype(int).tolist()
    chosen, exchanged = list(evenly), 0
    design = whole.design(chosen, criterion)
    for _ in range(PASSES):
        made = _exchange(design, chosen)
        exchanged += made
        if not made:
            break
    inner = whole
    if core is not None and not core.all():
        inner = condensed(covariance[np.ix_(core, core)], candidates[..., core], asked[:, core], count)
    checks = inner.design(chosen)
    if most_rise is not None:
        checks, made = _supported(checks, chosen, most_rise)
        exchanged += made
    variance, even = (whole.variances(whole.after(each)) for each in (chosen, evenly))
    numbers = np.count_nonzero(candidates[chosen].any(axis=2), axis=1)
    return Chosen(
        rows=tuple(chosen),
        exchanged=exchanged,
        sigma_mm=float(np.sqrt(variance.mean())),
        largest_mm=float(np.sqrt(variance.max())),
        even_sigma_mm=float(np.sqrt(even.mean())),
        even_largest_mm=float(np.sqrt(even.max())),
        rises=checks.rises(chosen),
        leverage=checks.leverage(chosen) / np.maximum(numbers, 1),
    )


def _exchange(design: Design, chosen: list[int]) -> int:
    """One pass: exchange each of `chosen`, which are measured, for a better candidate; the number of exchanges.

    Only those of the greatest gain at its begin are tried: a pass over all takes ten times as long, and the next pass
    begins with all again.
    """
    gains, before, made = design.gains(), set(chosen), 0
    gains[chosen] = np.inf
    pool = np.argsort(-gains, kind="stable")[: (TRIED + 1) * len(chosen)]
    small, place_of = design.among(pool), {int(row): at for at, row in enumerate(pool)}
    places = [place_of[row] for row in chosen]
    for at, old in enumerate(list(places)):
        gains = small.gains_without(old)
        gains[places[:at] + places[at + 1 :]] = -np.inf
        new = int(np.argmax(gains))
        if gains[new] > gains[old] + _BETTER * abs(gains[old]):
            small.exchange((old,), (new,))
            places[at], made = new, made + 1
    chosen[:] = pool[places].tolist()
    design.exchange(sorted(before - set(chosen)), sorted(set(chosen) - before))
    return made


def _supported(design: Design, chosen: list[int], most_rise: float) -> tuple[Design, int]:
    """Exchange rows of `chosen`, which are measured, until without any one of them the RMS error rises by no more than
    `most_rise`, or no exchange lowers the largest rise. The design after them, and the number of exchanges.

    The row whose loss costs most gets a second one beside it: the best candidate without it. Of the rows that cost
    least, the one is given up without which the largest rise is smallest.
    """
    for made in range(2 * len(chosen)):
        rises = design.rises(chosen)
        worst = int(np.argmax(rises))
        if rises[worst] <= most_rise:
            return design, made
        gains = design.gains_without(chosen[worst])
        gains[chosen] = -np.inf
        beside = int(np.argmax(gains))
        more = copy(design)
        more.measure(beside)
        tried = []
        for at in [at for at in np.argsort(more.rises(chosen)).tolist() if at != worst][:_SPARED]:
            fewer, rows = copy(more), [*chosen[:at], beside, *chosen[at + 1 :]]
            fewer.leave_out(chosen[at])
            tried.append((float(fewer.rises(rows).max()), fewer, rows))
        largest, fewer, rows = min(tried, key=lambda each: each[0])
        if largest >= rises[worst]:
            return design, made
        design, chosen[:] = fewer, rows
    return design, 2 * len(chosen)


def sigma_of(covariance: Floats, weight: Floats, points: float) -> float:
    """1 σ, 3-D, RMS over `points` places with the weight matrix Σ JᵀJ (P, P), mm."""
    return float(np.sqrt(max(float(np.sum(weight * covariance)), 0.0) / points))
