"""A new tool and the points it touches, found from many starts at once, and tools that explain the rows as well.

A touch gives |p + R t − c| = ρ for flange position p and rotation R, a tool t and a centre c. Squared, Rᵀc·t remains:
tool and centre are multiplied, and least squares from where the tool was stated to be ends in whichever local optimum
is nearest.

**Search.** The robot is held, so that tool and S centres are 3 + 3 S numbers, few enough for many starts in one batch:
the stated tool and points on `SHELLS_MM` about it, then about the best found, each followed to its optimum by
Levenberg–Marquardt with Marquardt's scaling (damping in proportion to the diagonal of JᵀJ; Marquardt 1963).

**Which one.** Each tool is judged by the probability of the rows, integrated over the prior P of all parameters:

    −2 ln p = rᵀS⁻¹r + ln det S,    S = I + J P Jᵀ.

An uncertain robot lowers the penalty of a tool's residuals. The odds of two tools are exp(½ (their difference)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.model.unknowns import State, Unknowns
from cellctl.calibration.rows import Rows, SpacingRows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.solver.estimate import Estimate, linearised
from cellctl.kinematics import Bools, Floats

SHELLS_MM = (5.0, 15.0, 40.0, 100.0)
"""Distances from the known tool: local optima were 7 … 25 mm apart (decision 13)."""

DIRECTIONS = 16
"""Tools are tried in so many directions at each of these distances."""

ROUNDS = 4
"""Maximum rounds about the best tool so far; the search ends at a round without a better one."""

UNSEEN = 1e-30
"""Holds tool and points that no distance determines: a point that starts at the TCP has no gradient."""

STEPS = 40
"""Maximum of each descent; one that needs more is in a flat valley, and no distinct optimum."""

SETTLED = 1e-6
"""A step that lowers χ² by less than this, absolutely or relative to it, is the last."""

TOUCHES = 200
"""The search uses at most so many touches: enough for tool and points; the fit then uses all."""

APART_MM = 0.5
"""Tools nearer than this to each other are one: descents end within micrometres of their optimum, and distinct optima
were 7 mm apart or more."""

TOOLS_AT_MOST = 8
"""At most so many distinct tools are kept, those nearest to the rows."""

IMPROBABLE = 0.01
"""A tool whose probability relative to the best is below this is rejected."""

ALIKE = 0.5
"""Two tools with odds of at least this are called equally probable in the message; nothing else depends on it."""

BEYOND = 16.3
"""A tool within this squared distance, in σ, of the one found is the same: 99.9 % of χ² with three degrees."""


@final
@dataclass(frozen=True, eq=False)
class Touched:
    """The touches made with the first session's tool, as equations for that tool and their points.

    tcps (N, 3), mm: with the tool as `state` has it; turn (N, 3, 3): how they move with it; point (N,): among `points`,
    the numbers of those touched; reach, sigma (N,), mm. pairs (M, 2), among `points`, mm, pair_sigma (M,): certified
    distances between them.
    """

    state: State
    tcps: Floats
    turn: Floats
    points: Any
    point: Any
    reach: Floats
    sigma: Floats
    pairs: Any
    mm: Floats
    pair_sigma: Floats

    @classmethod
    def of(cls, state: State, rows: RowBlocks, certified: Sequence[Rows]) -> Self:
        """From `rows`, and certified distances among `certified`."""
        shared = _sharing_the_tool(state)
        shown = [(block, block.distances) for block in rows.blocks if shared[block.session]]
        found = [(block, distances) for block, distances in shown if distances is not None]
        seen = [(state.models[block.session], block) for block, _ in found]
        number = np.concatenate([np.zeros(0, int), *(block.visited for block, _ in found)]).astype(int)
        points, point = np.unique(number, return_inverse=True)
        pairs, mm, pair_sigma = _certified(certified, points)
        tool = tool_of(state)
        return cls(
            state=state,
            tcps=np.concatenate([np.zeros((0, 3)), *(model.tcp(block.at) for model, block in seen)]),
            turn=np.concatenate([np.zeros((0, 3, 3)), *(model.jacobian(b.at)[:, :3, tool] for model, b in seen)]),
            points=points,
            point=point,
            reach=np.concatenate([np.zeros(0), *(distances for _, distances in found)]),
            sigma=np.concatenate([np.zeros(0), *(block.sigma[:, 0] for block, _ in found)]),
            pairs=pairs,
            mm=mm,
            pair_sigma=pair_sigma,
        )

    @property
    def unknown(self) -> int:
        """Count of unknown numbers."""
        return 3 + 3 * len(self.points)

    @property
    def lacking(self) -> int:
        """Count of distances that are missing to find them, with one at least as a check."""
        return max(self.unknown + 1 - len(self.reach) - len(self.mm), 0)

    def local_optima(self) -> list[State]:
        """The state at each local optimum of tool and points; those nearest to the rows first."""
        found, costs = self._searched()
        chosen: list[Floats] = []
        for index in np.argsort(costs, kind="stable"):
            if all(np.linalg.norm(found[index, :3] - other[:3]) > APART_MM for other in chosen):
                chosen.append(found[index])
            if len(chosen) == TOOLS_AT_MOST:
                break
        return [self._at(each) for each in chosen]

    def _at(self, x: Floats) -> State:
        """The state with tool and points at x (F,), the tool as a change."""
        shift, state = np.zeros(len(self.state.model.parameters)), self.state
        shift[tool_of(state)] = x[:3]
        models = [
            model.with_deviations(model.deviations + shift) if mine else model
            for model, mine in zip(state.models, _sharing_the_tool(state), strict=True)
        ]
        points = state.points.copy()
        points[self.points] = x[3:].reshape(-1, 3)
        return replace(state, models=tuple(models), points=points)

    def _searched(self) -> tuple[Floats, Floats]:
        """Local optima of tool and points (K, F) from many start tools, and their χ² (K,)."""
        some = self._fewer(TOUCHES)
        found, costs = some._settled(some._starts(np.zeros(3)))
        for _ in range(ROUNDS):
            best = int(np.argmin(costs))
            further, their_costs = some._settled(some._starts(found[best, :3]))
            better = their_costs.min() < costs[best] - SETTLED * (1.0 + costs[best])
            found, costs = np.vstack([found, further]), np.concatenate([costs, their_costs])
            if not better:
                break
        return found, costs

    def _starts(self, middle: Floats) -> Floats:
        """Tools about `middle` (3,), each with its points in the middle of their touches (K, F)."""
        tools = middle + np.concatenate([np.zeros((1, 3)), *(size * _directions(DIRECTIONS) for size in SHELLS_MM)])
        tcps = self.tcps + np.einsum("nij,kj->kni", self.turn, tools)
        middles = [tcps[:, self.point == index].mean(axis=1) for index in range(len(self.points))]
        return np.concatenate([tools, *middles], axis=1)

    def _settled(self, x: Floats) -> tuple[Floats, Floats]:
        """The local optimum nearest to each x (K, F), by Levenberg–Marquardt, and χ² there (K,)."""
        damping = np.full(len(x), 1e-3)  # of the diagonal: nearly Gauss–Newton; down five times, up five times
        away, columns = self._linear(x)
        cost = np.sum(away**2, axis=1)
        for _ in range(STEPS):
            tried = x - _damped(columns, away, damping)
            their_away, their_columns = self._linear(tried)
            fall = cost - np.sum(their_away**2, axis=1)
            good = fall > 0.0
            x, away = np.where(good[:, None], tried, x), np.where(good[:, None], their_away, away)
            columns, cost = np.where(good[:, None, None], their_columns, columns), cost - np.where(good, fall, 0.0)
            damping = np.clip(damping * np.where(good, 0.2, 5.0), 1e-12, 1e6)
            if np.all(np.abs(fall) < SETTLED * (1.0 + cost)):
                break
        return x, cost

    def _linear(self, x: Floats) -> tuple[Floats, Floats]:
        """Residuals of touches and certified distances at x (K, F), in σ (K, N + M); their derivative (…, F)."""
        points = x[:, 3:].reshape(len(x), -1, 3)
        away = self.tcps + np.einsum("nij,kj->kni", self.turn, x[:, :3]) - points[:, self.point]
        both = np.concatenate([away, points[:, self.pairs[:, 0]] - points[:, self.pairs[:, 1]]], axis=1)
        length, sigma = np.linalg.norm(both, axis=-1), np.concatenate([self.sigma, self.pair_sigma])
        along = both / np.maximum(length, 1e-9)[..., None] / sigma[:, None]
        columns, count = np.zeros((*along.shape[:2], 1 + points.shape[1], 3)), len(self.reach)
        touches, pairs = np.arange(count), np.arange(count, len(sigma))
        columns[:, touches, 0] = np.einsum("kni,nij->knj", along[:, :count], self.turn)
        columns[:, touches, 1 + self.point] = -along[:, :count]
        columns[:, pairs, 1 + self.pairs[:, 0]] = along[:, count:]
        columns[:, pairs, 1 + self.pairs[:, 1]] = -along[:, count:]
        return (length - np.concatenate([self.reach, self.mm])) / sigma, columns.reshape(*along.shape[:2], -1)

    def _fewer(self, count: int) -> Self:
        """The same with at most `count` of the touches, as many of each point as of any other."""
        order = np.random.default_rng(count).permutation(len(self.reach))
        rank = np.zeros(len(order), int)
        for index in range(len(self.points)):
            mine = order[self.point[order] == index]
            rank[mine] = np.arange(len(mine))
        some = np.sort(np.argsort(rank, kind="stable")[:count])
        rows = ("tcps", "turn", "point", "reach", "sigma")
        return replace(self, **{name: getattr(self, name)[some] for name in rows})


def _damped(columns: Floats, away: Floats, damping: Floats) -> Floats:
    """Levenberg–Marquardt steps (K, F), each unknown's damping scaled by its sensitivity."""
    turned = columns.swapaxes(1, 2)
    square = turned @ columns
    seen = np.einsum("kff->kf", square)
    held = damping[:, None] * seen + 1e-12 * seen.max(axis=1, keepdims=True) + UNSEEN
    step = np.linalg.solve(square + held[:, :, None] * np.eye(seen.shape[1]), turned @ away[..., None])
    return np.asarray(step[..., 0])


def _directions(count: int) -> Floats:
    """Unit vectors (count, 3), evenly spread: a Fibonacci sphere."""
    up = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - up**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=1)


def tool_of(state: State) -> list[int]:
    """Indices of the tool's place among the parameters of the first session's model."""
    parameters = enumerate(state.model.parameters)
    return [place for place, each in parameters if each.group == "tool" and not each.turns]


def _sharing_the_tool(state: State) -> Bools:
    """Which sessions use the first session's tool."""
    tool = tool_of(state)
    return np.array([np.array_equal(columns[tool], state.columns[0][tool]) for columns in state.columns])


def _certified(certified: Sequence[Rows], points: Any) -> tuple[Any, Floats, Floats]:
    """Certified distances between two of `points`: their places among these (M, 2), mm and σ (M,)."""
    blocks = [block for block in certified if isinstance(block, SpacingRows)]
    pairs = np.concatenate([np.zeros((0, 2), int), *(block.pairs for block in blocks)])
    both = np.isin(pairs, points).all(axis=1)
    mm = np.concatenate([np.zeros(0), *(block.mm for block in blocks)])
    sigma = np.concatenate([np.zeros(0), *(block.sigma[:, 0] for block in blocks)])
    return np.searchsorted(points, pairs[both]), mm[both], sigma[both]


def initial_states(unknowns: Unknowns, rows: RowBlocks, certified: Sequence[Rows]) -> list[State]:
    """Hypotheses for tool and points: the start of `unknowns` with each tool from a local optimum of its touches, the
    most probable first; unchanged where there are no touches.
    """
    touched = Touched.of(unknowns.start, rows, certified)
    if not len(touched.reach):
        return [unknowns.start]
    blocks = [*rows.blocks, *certified]
    return sorted(touched.local_optima(), key=lambda state: improbability(unknowns, state, blocks))


def with_rival_tools(found: Estimate, rows: RowBlocks, certified: Sequence[Rows], others: Sequence[State]) -> Estimate:
    """`found`; reported as not converged, with σ enlarged to cover them, where the rows make one of the tools `others`
    almost as probable, or are too few to find any.
    """
    blocks = [*rows.blocks, *certified]
    best, rivals = improbability(found.unknowns, found.state, blocks), []
    for other in others:
        moved = _move(found.state, other)
        odds = float(np.exp(0.5 * min(best - improbability(found.unknowns, other, blocks), 0.0)))
        if odds > IMPROBABLE and _is_another(found, moved):
            rivals.append((odds, moved))
    touched = Touched.of(found.state, rows, certified)
    if not rivals and not touched.lacking:
        return found
    wider = found.covariance + _spread(rivals, found.covariance.shape)
    return replace(found, covariance=wider, converged=False, ended=_too_few(touched) or _open(found, rivals))


def improbability(unknowns: Unknowns, state: State, blocks: Sequence[Rows]) -> float:
    """−2 ln of the probability of `blocks` about `state`, up to a constant; integrated over the uncertainty in
    `unknowns.prior`. With P = U Uᵀ and A = I + UᵀJᵀJU no matrix of the rows is needed: rᵀS⁻¹r = rᵀr − bᵀA⁻¹b, b =
    UᵀJᵀr, and det S = det A (Sylvester).
    """
    assert unknowns.prior is not None
    size = np.sqrt(np.diag(unknowns.prior))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(unknowns.prior / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    JtJ, Jtr, rtr = np.eye(len(root)), np.zeros(len(root)), 0.0
    for block in blocks:
        lines, away = linearised(block, state, np.arange(len(root)), scale)
        columns, residual = lines.reshape(-1, len(root)) @ root, away.reshape(-1)
        JtJ, Jtr = JtJ + columns.T @ columns, Jtr + columns.T @ residual
        rtr += float(residual @ residual)
    return rtr - float(Jtr @ np.linalg.solve(JtJ, Jtr)) + float(np.linalg.slogdet(JtJ)[1])


def _move(here: State, there: State) -> Floats:
    """Difference of all parameters (P,)."""
    result = np.zeros(here.width)
    for columns, one, other in zip(here.columns, here.models, there.models, strict=True):
        result[columns] = other.deviations - one.deviations
    result[here.of_points] = (there.points - here.points).ravel()
    return result


def _is_another(found: Estimate, moved: Floats) -> bool:
    """Whether the tool `moved` to (P,) lies outside the σ of the one found."""
    tool = tool_of(found.state)
    return bool(moved[tool] @ np.linalg.solve(found.covariance[np.ix_(tool, tool)], moved[tool]) > BEYOND)


def _spread(rivals: Sequence[tuple[float, Floats]], shape: tuple[int, ...]) -> Floats:
    """Variance (P, P) from the open choice of tool, with the odds and distances (P,) of the rivals.

    Σ w d dᵀ about the tool found, which is stated, not about the mean of all: larger than the variance of the mixture.
    """
    total = 1.0 + sum(odds for odds, _ in rivals)
    return np.asarray(sum((odds / total * np.outer(moved, moved) for odds, moved in rivals), np.zeros(shape)))


def _too_few(touched: Touched) -> str:
    """Message that distances are too few to find tool and points; empty where they are enough."""
    if not touched.lacking:
        return ""
    numbers = len(touched.reach) + len(touched.mm)
    what = f"{numbers} distances do not find, and check, {touched.unknown} numbers of tool and points"
    return f"{what}: {touched.lacking} more at least, or fewer points"


def _open(found: Estimate, rivals: Sequence[tuple[float, Floats]]) -> str:
    """Message that another tool is as good."""
    odds, moved = max(rivals, key=lambda rival: rival[0])
    away = float(np.linalg.norm(moved[tool_of(found.state)]))
    as_good = "as probable" if odds > ALIKE else f"{odds:.2g} times as probable"
    return (
        f"the rows leave open which tool it is: one {away:.1f} mm from that found is {as_good}; touch from more sides"
    )
