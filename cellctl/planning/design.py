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
not computed anew after each exchange: it changes by a product of rank k (`Design._change`).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Literal, Self, TypeAlias, final, get_args

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import Floats

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

_BETTER = 1e-9
"""A share of the criterion by which an exchange has to be better: rounding must not exchange for ever."""


@final
class Design:
    """Candidates and what is known after the rows chosen so far. Criteria are costs: smaller is better.

    covariance (P, P): before any row, in the parameters' units; for A in those of their prior σ. candidates (M, k, P):
    Jacobians in standard deviations, filled up with zeros where a row has fewer than k numbers. asked (3 N, P):
    derivative of the task's places by the parameters, mm. left (N,): variance of each place, mm², that no row changes.
    """

    def __init__(
        self,
        covariance: Floats,
        candidates: Floats,
        asked: Floats,
        criterion: Criterion = "volume",
        left: Floats | None = None,
    ) -> None:
        self._candidates, self._criterion = candidates, criterion
        self._flat = np.ascontiguousarray(candidates.reshape(-1, candidates.shape[2]))
        self._weight = np.eye(len(covariance)) if criterion == "A" else asked.T @ asked / (len(asked) / 3.0)
        self._places = _places(candidates, asked, criterion)
        self._left = np.zeros(len(self._places)) if left is None or criterion != "max" else left[_some(len(left))]
        self.covariance, carried = covariance, self._flat @ covariance
        # what `gains` needs of each candidate a: aCaᵀ, and aCWCaᵀ or aCJᵀ of all places
        self._spread = self._of_rows(carried)
        by_weight = criterion in ("volume", "A")
        self._felt = self._of_rows(carried @ (self._weight @ covariance)) if by_weight else None
        places = self._places.reshape(-1, len(covariance))
        self._crossed = (carried @ places.T).reshape(*candidates.shape[:2], len(places))

    def among(self, some: NDArray[np.int_]) -> Self:
        """The same with these candidates alone, in this order."""
        fewer = copy(self)
        fewer._candidates, fewer._spread, fewer._crossed = (
            self._candidates[some],
            self._spread[some],
            self._crossed[some],
        )
        fewer._flat = np.ascontiguousarray(fewer._candidates.reshape(-1, len(self.covariance)))
        fewer._felt = None if self._felt is None else self._felt[some]
        return fewer

    def gains(self) -> Floats:
        """By how much each candidate (M,) alone would lower the criterion."""
        system = np.eye(self._spread.shape[1]) + self._spread
        if self._criterion == "D":
            return np.asarray(np.linalg.slogdet(system)[1])
        if self._felt is not None:
            return np.asarray(np.trace(np.linalg.solve(system, self._felt), axis1=1, axis2=2))
        # J C aᵀ (I + aCaᵀ)⁻¹ a C Jᵀ of each place: |L⁻¹ a C Jᵀ|², L Lᵀ = I + aCaᵀ
        lowered = np.linalg.solve(np.linalg.cholesky(system), self._crossed) ** 2
        variance = self._left + np.einsum("nip,pq,niq->n", self._places, self.covariance, self._places, optimize=True)
        after = variance - lowered.sum(axis=1).reshape(len(lowered), *self._places.shape[:2]).sum(axis=2)
        return np.asarray(variance.max() - after.max(axis=1))

    def measure(self, row: int) -> None:
        """Take candidate `row` as measured."""
        self._change(row, 1.0)

    def leave_out(self, row: int) -> None:
        """Take candidate `row`, which was measured, as not measured."""
        self._change(row, -1.0)

    def _change(self, row: int, sign: float) -> None:
        """With b the row, G = Cbᵀ and K = ±(I ± bCbᵀ)⁻¹: C' = C − GKGᵀ, so that of a candidate a, with t = aG and
        h = aCWG: aC'aᵀ = aCaᵀ − tKtᵀ, aC'WC'aᵀ = aCWCaᵀ − tKhᵀ − hKtᵀ + tK(GᵀWG)Ktᵀ, aC'Jᵀ = aCJᵀ − tKGᵀJᵀ.
        """
        b, count = self._candidates[row], self._candidates.shape[1]
        gain = self.covariance @ b.T
        middle = sign * np.linalg.inv(np.eye(len(b)) + sign * b @ gain)
        if self._felt is None:
            t = (self._flat @ gain).reshape(-1, count, len(b))
        else:
            heavy = self._weight @ gain
            both = (self._flat @ np.hstack([gain, self.covariance @ heavy])).reshape(-1, count, 2 * len(b))
            t, h = both[..., : len(b)], both[..., len(b) :]
            crossed = t @ middle @ np.swapaxes(h, 1, 2)
            own = t @ (middle @ (gain.T @ heavy) @ middle) @ np.swapaxes(t, 1, 2)
            self._felt = self._felt - crossed - np.swapaxes(crossed, 1, 2) + own
        self._spread = self._spread - t @ middle @ np.swapaxes(t, 1, 2)
        if len(self._places):
            places = self._places.reshape(-1, len(gain))
            self._crossed = self._crossed - np.tensordot(t @ middle, gain.T @ places.T, 1)
        self.covariance = updated(self.covariance, b, sign)

    def _of_rows(self, carried: Floats) -> Floats:
        """`carried` (M k, P) times each candidate's own rows: (M, k, k)."""
        return np.asarray(np.matmul(carried.reshape(self._candidates.shape), np.swapaxes(self._candidates, 1, 2)))


def _places(candidates: Floats, asked: Floats, criterion: Criterion) -> Floats:
    """Derivatives (N, 3 or k, P) at the places whose largest variance counts; none for the other criteria."""
    rows = candidates if criterion == "G" else asked.reshape(-1, 3, asked.shape[1])
    if criterion not in ("max", "G"):
        return rows[:0]
    return rows[_some(len(rows))]


def _some(count: int) -> NDArray[np.int_]:
    return np.unique(np.linspace(0, count - 1, min(count, LARGEST_OF)).astype(int))


@final
@dataclass(frozen=True, eq=False)
class _Condensed:
    """Candidates (M, k, R) in their standard deviations, places (3 N, R), mm; per unit of parameters with prior σ 1."""

    candidates: Floats
    asked: Floats


def condensed(covariance: Floats, candidates: Floats, asked: Floats, count: int) -> tuple[_Condensed, Floats]:
    """The same problem with as few parameters as `count` rows can tell apart; and the variance (N,), mm², of each place
    by the others, which no choice of `count` rows changes.

    With C = SSᵀ the candidates in units of the prior are AS; the eigenvectors u of SᵀAᵀAS have λ, the sum over all
    candidates of the information along u. `count` average rows bring λ count / M of it, against the 1 of the prior:
    where that is below `_UNSEEN` the direction keeps its prior, whatever is chosen. Effects with hundreds of amounts
    (harmonics, a discrepancy) are mostly such directions.
    """
    root = _root(covariance)
    rows = candidates.reshape(-1, len(covariance)) @ root
    information, directions = np.linalg.eigh(rows.T @ rows)
    seen = information * count / len(candidates) > _UNSEEN
    places = asked @ root
    left = np.sum((places @ directions[:, ~seen]) ** 2, axis=1).reshape(-1, 3).sum(axis=1)
    kept = directions[:, seen]
    return _Condensed((rows @ kept).reshape(*candidates.shape[:2], -1), places @ kept), left


def _root(covariance: Floats) -> Floats:
    """S with SSᵀ = C, of a covariance that may be singular (parameters that are held)."""
    if not (covariance - np.diag(np.diag(covariance))).any():
        return np.diag(np.sqrt(np.diag(covariance)))
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


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
    candidates; without_one_mm (K,): RMS without each of the rows.
    """

    rows: tuple[int, ...]
    exchanged: int
    sigma_mm: float
    largest_mm: float
    even_sigma_mm: float
    even_largest_mm: float
    without_one_mm: Floats


def chosen_rows(
    covariance: Floats, candidates: Floats, asked: Floats, count: int, criterion: Criterion = "volume"
) -> Chosen:
    """The `count` of `candidates` that are best by `criterion`; for the arguments see `Design`."""
    count = min(count, len(candidates))
    rows, left = condensed(covariance, candidates, asked, count)
    evenly: list[int] = np.linspace(0, len(candidates) - 1, count).astype(int).tolist()
    chosen, exchanged = list(evenly), 0
    for _ in range(PASSES):
        design = Design(_after(rows.candidates, chosen), rows.candidates, rows.asked, criterion, left)
        made = _exchange(design, chosen)
        exchanged += made
        if not made:
            break
    after = [_after(rows.candidates, each) for each in (chosen, evenly)]
    variance, even = (_variances(each, rows.asked) + left for each in after)
    without = [updated(after[0], rows.candidates[row], -1.0) for row in chosen]
    return Chosen(
        rows=tuple(chosen),
        exchanged=exchanged,
        sigma_mm=float(np.sqrt(variance.mean())),
        largest_mm=float(np.sqrt(variance.max())),
        even_sigma_mm=float(np.sqrt(even.mean())),
        even_largest_mm=float(np.sqrt(even.max())),
        without_one_mm=np.sqrt([np.mean(_variances(each, rows.asked) + left) for each in without]),
    )


def _exchange(design: Design, chosen: list[int]) -> int:
    """One pass: exchange each of `chosen`, which are measured, for a better candidate; the number of exchanges.

    Only those of the greatest gain at its begin are tried: a pass over all takes ten times as long, and the next pass
    begins with all again.
    """
    gains, made = design.gains(), 0
    gains[chosen] = np.inf
    pool = np.argsort(-gains, kind="stable")[: (TRIED + 1) * len(chosen)]
    design, place_of = design.among(pool), {int(row): at for at, row in enumerate(pool)}
    places = [place_of[row] for row in chosen]
    for at, old in enumerate(list(places)):
        design.leave_out(old)
        gains = design.gains()
        gains[places[:at] + places[at + 1 :]] = -np.inf
        new = int(np.argmax(gains))
        if gains[new] > gains[old] + _BETTER * abs(gains[old]):
            places[at], made = new, made + 1
        design.measure(places[at])
    chosen[:] = pool[places].tolist()
    return made


def _after(candidates: Floats, chosen: list[int]) -> Floats:
    """The covariance (P, P) after the candidates `chosen`, of a prior 1: (1 + Σ aᵀa)⁻¹."""
    rows = np.concatenate(candidates[chosen])
    return np.asarray(np.linalg.inv(np.eye(rows.shape[1]) + rows.T @ rows))


def _variances(covariance: Floats, asked: Floats) -> Floats:
    """tr(J C Jᵀ) (N,), mm², of places with derivatives `asked` (3 N, P)."""
    return np.asarray(np.sum((asked @ covariance) * asked, axis=1).reshape(-1, 3).sum(axis=1))


def sigma_of(covariance: Floats, weight: Floats, points: float) -> float:
    """1 σ, 3-D, RMS over `points` places with the weight matrix Σ JᵀJ (P, P), mm."""
    return float(np.sqrt(max(float(np.sum(weight * covariance)), 0.0) / points))
