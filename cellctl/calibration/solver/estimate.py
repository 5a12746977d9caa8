"""The estimator: the most probable parameters given rows and tolerances, by Levenberg–Marquardt in tolerance units.

Unknowns are deviations ξ (P,) from the expected robot, with prior N(0, Σ₀); rows are y_i = f_i(ξ) + ε_i with
independent ε_i ~ N(0, σ_i²). The posterior mode minimises the weighted sum of squares

    χ²(x) = ‖r(x)‖² + ‖W x‖²,    r_i = (f_i − y_i)/σ_i,    x = ξ/σ₀,

σ₀ the prior standard deviations, WᵀW the inverse of the prior covariance of x (the identity for independent
tolerances). In these units cost, steps and singular values are pure numbers: mm and rad need no weights, and a
singular value of 1 says that the rows know a direction as well as the tolerances do. A flat prior is a large σ₀.

**Step.** With J = ∂r/∂x, r(x + s) ≈ r + J s, and the step solves the stacked least squares problem

    min ‖J s + r‖² + ‖W (x + s)‖² + μ ‖s‖²

by QR, not by the normal equations: the condition number of JᵀJ is that of J squared, and nearly unobservable
directions (the reason for the prior) would be lost to rounding (Björck 1996, Numerical Methods for Least Squares
Problems). QR is done block by block, [R; J_k] → R, so that memory does not grow with the rows. μ begins at 0
(Gauss–Newton), grows tenfold when χ² does not fall, and shrinks tenfold when it does (Nocedal and Wright 2006,
Numerical Optimization, section 10.3). The damping is a multiple of the identity: the unknowns are scaled already. The
search ends when an undamped step promises a fall of χ² below `SETTLED`.

**Covariance.** With R the triangle of J alone, Σ = (RᵀR + WᵀW)⁻¹, scaled back by σ₀. Two kinds of unknowns are not
free and add to it. *Pinned* combinations, unobservable ones of base and tool, are held by rows of weight `PINNED` and
put back into Σ with their own uncertainty. *Considered* ones, held parameters of a prior model, act through the free
ones' answer −Σ RᵀR_h (consider covariance; Tapley, Schutz and Born 2004, Statistical Orbit Determination, chapter 6).
The effective number of parameters, tr((RᵀR + WᵀW)⁻¹ RᵀR), is MacKay's γ: what the rows determined and the prior did
not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np
from scipy.linalg import solve_triangular

from cellctl.calibration.model.unknowns import State, Unknowns
from cellctl.calibration.rows import Rows
from cellctl.kinematics import Floats

BLOCK = 2048
"""Rows linearised at a time."""

ITERATIONS = 60
"""A fit whose rows agree takes three to five; so many only where each step lowers the cost a little."""

UNDAMPED = 1e-9
"""μ, relative to the squared norm of the largest column: the first damping after a step that failed, tenfold each time;
below it, none. In a well-posed problem it changes nothing above the rounding of JᵀJ."""

STUCK = 1e6
"""μ at which steps are a millionth of the gradient's scale: a smaller one cannot lower the cost either."""

PINNED = 1e4
"""Pinned combinations are held to a ten-thousandth of their tolerance: stiff enough not to move, and its
square leaves the rows beside it eight digits in normal equations (`held_beforehand`)."""

SETTLED = 1e-9
"""A step that would lower the cost (a χ²) by less than this, absolutely or relative to it, is the last."""


@final
@dataclass(frozen=True, eq=False)
class Estimate:
    """The outcome of a fit.

    deviations (P,): from the start, in the parameters' units, 0 where not free. covariance (P, P): of the posterior, 0
    where neither free nor considered beforehand. triangle (F, F): R of the *data alone* at the solution, columns in
    tolerances, free parameters only. whitening (F, F): root of what was known beforehand, in the same units. ended: how
    it ended, in words.
    """

    unknowns: Unknowns
    deviations: Floats
    covariance: Floats
    triangle: Floats
    whitening: Floats
    cost: float
    iterations: int
    converged: bool
    ended: str

    @property
    def state(self) -> State:
        """The identified robot and points."""
        return self.unknowns.state(self.deviations)

    @property
    def effective_parameters(self) -> float:
        """Effective number of parameters that the data determined; tolerances determined the other free ones.

        γ = Σ s²/(1 + s²) over the singular values s of R W⁻¹. Pinned combinations count too, although they are
        held: one with s = 3 by 0.9. γ is then too large by up to their number.
        """
        data = self.triangle.T @ self.triangle
        known = self.whitening.T @ self.whitening
        return float(np.trace(np.linalg.solve(data + known, data))) if len(data) else 0.0


@final
@dataclass(frozen=True, eq=False)
class _Problem:
    """Unknowns and rows, constant over the iterations. holding: whitening, and what is pinned."""

    unknowns: Unknowns
    blocks: tuple[Rows, ...]
    free: Any
    scale: Floats
    whitening: Floats
    holding: Floats

    @classmethod
    def of(cls, unknowns: Unknowns, blocks: Sequence[Rows]) -> Self:
        free = np.flatnonzero(unknowns.free)
        scale = unknowns.sigma[free]
        whitening = _whitening(unknowns, free)
        return cls(unknowns, tuple(blocks), free, scale, whitening, np.vstack([whitening, pins(unknowns, free)]))

    def deviations(self, x: Floats) -> Floats:
        """All parameters' deviations (P,) at x (F,)."""
        deviations = np.zeros(len(self.unknowns.names))
        deviations[self.free] = x * self.scale
        return deviations

    def cost(self, x: Floats) -> float:
        """χ² of rows and tolerances."""
        state = self.unknowns.state(self.deviations(x))
        of_rows = sum(np.sum((rows.residual(state) / rows.sigma) ** 2) for rows in _parts(self.blocks))
        return float(of_rows + np.sum((self.holding @ x) ** 2))

    def fold(self, x: Floats, columns: Any, scale: Floats) -> Floats:
        """The linearised rows in tolerance units as a triangle (C, C + 1): columns, then the right side."""
        state = self.unknowns.state(self.deviations(x))
        folded = np.zeros((0, columns.size + 1))
        for rows in _parts(self.blocks):
            lines, residual = linearised(rows, state, columns, scale)
            both = np.concatenate([lines, residual[..., None]], axis=-1).reshape(-1, columns.size + 1)
            folded = np.asarray(np.linalg.qr(np.vstack([folded, both]), mode="r"))
        square = np.zeros((columns.size, columns.size + 1))
        kept = folded[: columns.size]
        square[: len(kept)] = kept
        return square

    def step(self, triangle: Floats, right: Floats, x: Floats, damping: float) -> tuple[Floats, float]:
        """Damped step (F,) and the fall in cost that an undamped one promises."""
        # QR of [R r; W Wx] gives [R' c]: the undamped step is −R'⁻¹c, and χ² of the linear problem falls by ‖c‖²
        stacked = np.vstack([triangle, self.holding])
        residual = np.concatenate([right, self.holding @ x])
        both = _triangle(np.column_stack([stacked, residual]), x.size)
        root, along = both[:, :-1], both[:, -1]
        if damping:
            # √μ times the largest column norm: μ is relative to the best known direction
            damped = np.sqrt(damping) * np.linalg.norm(root, axis=0).max() * np.eye(x.size)
            again = np.vstack([both, np.column_stack([damped, np.zeros(x.size)])])
            folded = _triangle(again, x.size)
            root, right = folded[:, :-1], folded[:, -1]
        else:
            right = along
        return np.asarray(-solve_triangular(root, right, check_finite=False)), float(along @ along)


def estimate(
    unknowns: Unknowns,
    blocks: Sequence[Rows],
    begin: Floats | None = None,
    follow: Callable[[Floats], None] | None = None,
) -> Estimate:
    """Fit the free unknowns to `blocks`, from where they are expected, or from deviations `begin` (P,).

    Always ends; `ended` reports whether it converged. follow: is called with the deviations (P,) at the start and after
    each step that lowers the cost.
    """
    problem = _Problem.of(unknowns, blocks)
    x = np.zeros(problem.free.size) if begin is None else begin[problem.free] / problem.scale
    damping, ended, converged = 0.0, "", False
    cost, iteration, folded = problem.cost(x), 0, None
    if follow:
        follow(problem.deviations(x))
    for iteration in range(1, ITERATIONS + 1):
        folded = problem.fold(x, problem.free, problem.scale) if folded is None else folded
        step, promise = problem.step(folded[:, :-1], folded[:, -1], x, damping) if x.size else (x, 0.0)
        if promise <= SETTLED * (1.0 + cost):
            converged, ended = True, f"converged in {iteration} iterations"
            break
        tried = x + step
        new_cost = problem.cost(tried)
        if new_cost < cost:
            x, cost, folded = tried, new_cost, None
            if follow:
                follow(problem.deviations(x))
            damping = damping * 0.1 if damping > UNDAMPED else 0.0
        elif damping < STUCK:
            damping = max(damping * 10.0, UNDAMPED)
        else:
            ended = "no step lowers the residual any further: rows contradict the model, or each other"
            break
    else:
        ended = f"still improving after {ITERATIONS} iterations: the start is far from the measurements"
    triangle = (problem.fold(x, problem.free, problem.scale) if folded is None else folded)[:, :-1]
    return Estimate(
        unknowns=unknowns,
        deviations=problem.deviations(x),
        covariance=_covariance(problem, x, triangle),
        triangle=triangle,
        whitening=problem.whitening,
        cost=cost,
        iterations=iteration,
        converged=converged,
        ended=ended,
    )


def triangle_at_start(unknowns: Unknowns, blocks: Sequence[Rows]) -> Floats:
    """`Estimate.triangle` (F, F) where the unknowns are expected."""
    problem = _Problem.of(unknowns, blocks)
    return problem.fold(np.zeros(problem.free.size), problem.free, problem.scale)[:, :-1]


def triangle_with_model_error(unknowns: Unknowns, blocks: Sequence[Rows]) -> Floats:
    """`triangle_at_start` (F, F), with the model's error as extra noise: the effect on the rows (RMS over all) of held
    unknowns within what is known of them, as far as the free ones cannot absorb it. With L their triangle below that of
    the free ones and C their prior covariance: R/√(1 + v), v = tr(L C Lᵀ)/n.
    """
    problem = _Problem.of(unknowns, blocks)
    held, count = np.flatnonzero(~unknowns.free & (unknowns.sigma > 0.0)), problem.free.size
    columns = np.concatenate([problem.free, held])
    folded = problem.fold(np.zeros(count), columns, unknowns.sigma[columns])[:, :-1]
    left = folded[count:, count:]  # the held columns: the triangle has the free ones first
    variance = np.sum(left @ unknowns.known(held) * left) / max(sum(rows.sigma.size for rows in blocks), 1)
    return np.asarray(folded[:count, :count] / np.sqrt(1.0 + variance))


def covariance_of(found: Estimate, unknowns: Unknowns, blocks: Sequence[Rows]) -> Floats:
    """Posterior covariance (P, P) at the solution `found`, with all free parameters of `unknowns` free."""
    problem = _Problem.of(unknowns, blocks)
    x = found.deviations[problem.free] / problem.scale
    return _covariance(problem, x, problem.fold(x, problem.free, problem.scale)[:, :-1])


def linearised(rows: Rows, state: State, columns: Any, scale: Floats) -> tuple[Floats, Floats]:
    """Derivative of `rows` by the parameters at `columns` (C), per `scale` (C,) of each (N, k, C), and the distance of
    the model from them (N, k); both in the rows' standard deviations.
    """
    return rows.jacobian(state)[..., columns] * scale / rows.sigma[..., None], rows.residual(state) / rows.sigma


def _parts(blocks: Sequence[Rows]) -> Iterable[Rows]:
    for rows in blocks:
        for start in range(0, len(rows), BLOCK):
            yield rows if len(rows) <= BLOCK else rows.pick(np.s_[start : start + BLOCK])


def _covariance(problem: _Problem, x: Floats, triangle: Floats) -> Floats:
    """Posterior covariance (P, P), in the parameters' units: of the free ones, and through the considered ones.

    With M = (RᵀR + WᵀW)⁻¹ the free ones answer an error δ of held ones by −M RᵀR_h δ (Schmidt's *consider* covariance).
    This takes free and held ones as uncorrelated beforehand; `Task._with_prior` clears the covariance of those found
    anew.
    """
    unknowns, free, scale = problem.unknowns, problem.free, problem.scale
    result = np.zeros((len(unknowns.names),) * 2)
    exact = own = _posterior(triangle, problem.holding)
    if unknowns.pinned is not None and len(unknowns.pinned) and free.size:
        own = own + _of_the_pinned(unknowns.pinned[:, free], triangle, exact)
    if unknowns.prior is not None:
        considered = np.flatnonzero(unknowns.considered)
        columns = np.concatenate([free, considered])
        folded = problem.fold(x, columns, np.concatenate([scale, np.ones(len(considered))]))[:, :-1]
        count, known = free.size, unknowns.prior[np.ix_(considered, considered)]
        answer = -exact @ folded[:, :count].T @ folded[:, count:]
        own = own + answer @ known @ answer.T
        result[np.ix_(free, considered)] = scale[:, None] * (answer @ known)
        result[np.ix_(considered, free)] = result[np.ix_(free, considered)].T
        result[np.ix_(considered, considered)] = known
    result[np.ix_(free, free)] = own * np.outer(scale, scale)
    return result


def _of_the_pinned(pinned: Floats, triangle: Floats, own: Floats) -> Floats:
    """Covariance (F, F) of the free unknowns from pinned combinations, each uncertain by its whole tolerance, or by its
    share 1/s of it (rows of length s > 1); `own` is the covariance with these exact. The rows are scaled right singular
    vectors (`identify._unobservable_placements`), orthogonal to each other: R of their QR holds their lengths.
    """
    along, lengths = np.linalg.qr(pinned.T)
    along = along / np.maximum(np.abs(np.diag(lengths)), 1.0)
    # a free unknown answers an error δ along the pinned direction by −Σ RᵀR δ; δ itself is added
    owed = along - own @ (triangle.T @ (triangle @ along))
    return np.asarray(owed @ owed.T)


def _posterior(triangle: Floats, whitening: Floats) -> Floats:
    """Posterior covariance (F, F) in tolerance units: (RᵀR + WᵀW)⁻¹."""
    if not triangle.size:
        return np.zeros_like(triangle)
    root = _triangle(np.vstack([triangle, whitening]), triangle.shape[1])
    inverse = solve_triangular(root, np.eye(len(root)), check_finite=False)
    return np.asarray(inverse @ inverse.T)


def _triangle(stacked: Floats, rows: int) -> Floats:
    """The first `rows` rows of R of a QR factorisation."""
    return np.asarray(np.linalg.qr(stacked, mode="r"), float)[:rows]


def _whitening(unknowns: Unknowns, free: Any) -> Floats:
    """Root (F, F) of what is known of the `free` unknowns (indices) beforehand, in tolerances."""
    return np.eye(len(free)) if unknowns.prior is None else _inverse_root(unknowns.known(free))


def held_beforehand(unknowns: Unknowns, free: Any) -> Floats:
    """What is known of the `free` unknowns (indices) beforehand, and what is pinned, in tolerances, as normal equations
    (F, F).
    """
    lines = np.vstack([_whitening(unknowns, free), pins(unknowns, free)])
    return np.asarray(lines.T @ lines)


def pins(unknowns: Unknowns, free: Any) -> Floats:
    """Rows (H, F), in tolerances, that hold pinned combinations of the `free` unknowns (indices) where they start."""
    return np.zeros((0, len(free))) if unknowns.pinned is None else PINNED * unknowns.pinned[:, free]


def _inverse_root(covariance: Floats) -> Floats:
    """W (F, F) with WᵀW the inverse of `covariance`; exactly known combinations get a tiny variance."""
    values, vectors = np.linalg.eigh(covariance)
    # of the greatest: 1e-7 of the greatest σ, the rounding of a prior model's file and of its inverse
    floor = 1e-14 * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray((vectors / np.sqrt(np.maximum(values, floor))).T)
