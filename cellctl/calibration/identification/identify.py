"""Identification: find the inliers, register, fit, and scale noise and priors by evidence, until these settle.

The order of what is estimated from what, each step from the one before:

1. *Start*: nominal registered on the rows nearest to it (`_registered_on_closest`; concentration steps of least trimmed
   squares, Rousseeuw and Van Driessen 1999), so that outliers do not decide where the search begins.
2. *Inliers* about a fit of the inliers, again until they stay the same (`outliers`).
3. *Fit* of the inliers (`solver.estimate`), with noise and prior scales from the evidence of its linearisation
   (`solver.evidence`), a few times: the scales change the solution, and the solution the linearisation.
4. *Residual model*, where these residuals are still larger than predicted; rows that it predicts come back.
5. *Error maps*, if the model has them, from what all this leaves.

Nothing of it sees a held-out row. Of many rows a sample is searched, equally of each block and point: a uniform one
would have six of thirty-six touches beside twenty thousand positions, too few to detect an outlier.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.effects import ResidualModel, functions
from cellctl.calibration.folds import judging, random_folds
from cellctl.calibration.identification.learning import with_maps
from cellctl.calibration.identification.outliers import OUTLIER_P, OUTLYING, find_inliers
from cellctl.calibration.model.learnt_map import learnt_maps
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.unknowns import PLACED, State, Unknowns
from cellctl.calibration.prediction.predict import predict_rows
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows import Rows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.rows.type_rows import OF_TYPE, TypeRows
from cellctl.calibration.selection.cross_validation import Folded, Linear
from cellctl.calibration.selection.model_error import (
    ROWS_AT_LEAST,
    WORSE_AT_END,
    Gain,
    carried,
    may_join,
    scales_with,
    widened,
    with_kind,
    without_functions,
    worst_end,
)
from cellctl.calibration.solver.estimate import Estimate, covariance_of, estimate, triangle_with_model_error
from cellctl.calibration.solver.evidence import Factor, estimated, factors, unexpected, unlike_its_type
from cellctl.calibration.solver.tool_search import initial_states, with_rival_tools
from cellctl.kinematics import Bools, Floats

OUTLIERS_AT_MOST = 0.2
FEW = 2
"""If more than this share of the rows, or of those of one block, are not inliers, the rows cannot show which are
right, and all stay; so few rows may always be left out.
"""

CLOSEST = 0.6
"""The share of the rows, those nearest to nominal, that the search for the inliers starts from: more than half,
so that outliers that agree cannot be those, and up to 40 % of outliers do not decide the start."""

ROUNDS = 8
"""Of a search for inliers at the most: two sets that alternate would never end."""

OVERDETERMINED = 2
"""Measured numbers for each unknown of the registration from which on rows can be checked against each other."""

SCALINGS = 6
SETTLED = 0.02
"""Noise and prior scales have settled when none changes by more than this share, a fifth of the σ of a noise scale from
fifty numbers (1/√(2n)); after so many rounds at the latest."""

INVISIBLE = 100.0
"""A metre of base or tool that moves all rows together by fewer standard deviations than this is unobservable: rows and
tolerances leave 10 mm of it open (a radian: 0.6°). σ = 1/s of the flat prior, and s of a real direction is thousands:
no limit between the two is critical."""

FLAT = 100.0
"""Prior σ (mm) above which a zero counts as unknown beforehand."""

FEW_SCALES = 5
"""With more prior scales than this, as with the bands of harmonics, a rough value of each is enough: ten times
`SETTLED`, a fifth."""

SEARCHED = 3000
"""Up to so many rows are searched for inliers; of more, a sample is searched and predicts the others. A limit of time:
each step of the search inverts the normal equations of all rows."""


def sampled(rows: RowBlocks, most: int) -> Any:
    """Indices, ascending, of `most` of the `rows` (all, if these are fewer), at random: equally many of each block, and
    within it of each point, as far as it has them.
    """
    rng = np.random.default_rng(len(rows))
    chosen = [np.zeros(0, int)]
    shares = _shared([len(block) for block in rows.blocks], most)
    for (block, mine, _), share in zip(rows.parts(), shares, strict=True):
        order = rng.permutation(len(block))
        point = block.visited[order]
        points, sizes = np.unique(point, return_counts=True)
        for each, own in zip(points, _shared(sizes, share), strict=True):
            chosen.append(mine.start + order[point == each][:own])
    return np.sort(np.concatenate(chosen))


def _shared(sizes: Any, most: int) -> Any:
    """How many of each of `sizes` (S,) make `most`: all of small ones, and as many of each of the others."""
    result = np.zeros(len(sizes), int)
    for done, place in enumerate(np.argsort(sizes, kind="stable")):
        result[place] = min(sizes[place], (most - result.sum()) // (len(sizes) - done))
    return result


@final
@dataclass(frozen=True, eq=False)
class Identification:
    """The nominal robot registered on the rows, the identified one, and the identified noise of the rows.

    noise: factor on the rows' standard deviations, for each of `RowBlocks.quantities`. used, outliers: indices into the
    task's rows that both estimates use, and that were left out. n_inconsistent: number of rows that were not inliers
    where these were too many to leave out; 0 otherwise. prior_scale: factor on the tolerances of each group where the
    robot is further from nominal than they predict. without_maps: the same before error maps were learnt; None for a
    model without maps.
    """

    nominal: Estimate
    identified: Estimate
    noise: Floats
    used: tuple[int, ...]
    outliers: tuple[int, ...]
    n_inconsistent: int = 0
    prior_scale: Mapping[Group, float] = field(default_factory=dict)
    without_maps: Identification | None = None


@final
@dataclass(frozen=True, eq=False)
class Scales:
    """Factors on the stated σ of noise and on the prior σ (not weights, which are 1/σ²)."""

    noise: Floats
    prior_scale: Mapping[Group, float]

    @classmethod
    def as_stated(cls, rows: RowBlocks) -> Self:
        """All factors 1."""
        return cls(np.ones(len(rows.quantities)), {})

    @classmethod
    def of(cls, rows: RowBlocks, factors: Mapping[Factor, float]) -> Self:
        """These factors of noise and of prior scales."""
        return cls(_noise(rows, factors), {name: value for (name, _), value in factors.items() if name != "noise"})

    def factors(self, rows: RowBlocks) -> dict[Factor, float]:
        """The factors from which `of` makes these scales."""
        found: dict[Factor, float] = {(name, 0): value for name, value in self.prior_scale.items()}
        for block, _, own in rows.parts():
            for quantity in dict.fromkeys(block.quantities):
                number = own.start + block.quantities.index(quantity)
                found["noise", number] = float(self.noise[number])
        return found

    def settled(self, before: Self) -> bool:
        """Whether these scales are close to those `before`; rough values are enough for the sizes of effects."""
        groups = {*before.prior_scale, *self.prior_scale}
        change = [
            abs(np.log(self.prior_scale.get(group, 1.0) / before.prior_scale.get(group, 1.0))) for group in groups
        ]
        roughly = SETTLED if len(groups) <= FEW_SCALES else 10.0 * SETTLED
        return bool(max([0.0, *change]) < roughly and np.abs(np.log(self.noise / before.noise)).max() < roughly)


@final
@dataclass(frozen=True, eq=False)
class ScaledFit:
    """A fit with its scales."""

    found: Estimate
    scales: Scales

    def p_values(self, rows: RowBlocks) -> Floats:
        """p-values (N,): the probability that a row not in the fit lies as far from it as it does, or further."""
        blocks = rows.noisier(self.scales.noise).blocks
        return np.concatenate([predict_rows(self.found.state, self.found.covariance, each).p_value for each in blocks])


def identify(
    task: Task, fit: Any = None, known_inliers: tuple[Bools, int] | None = None, scales: Scales | None = None
) -> Identification:
    """Identify `task.model` from the rows at `fit` (indices or mask; default all). No other row is used.

    Outliers are left out. Where the inliers are clearly noisier than their stated σ, the robot is further from nominal
    than the tolerances, or the model is incomplete, the evidence of the rows sets noise, prior scales and a residual
    model; noise and tolerances never shrink. Rows that were outliers only because the model was incomplete are used
    again. known_inliers: which rows they are (`inliers_among`), scales: noise and prior scales, where known.
    Error maps are learnt last, from the inliers; those of a prior model stay as they are. Raises ValueError for rows
    that make no map.
    """
    chosen = np.arange(len(task.rows)) if fit is None else np.sort(np.arange(len(task.rows))[fit])
    rows = task.rows.pick(chosen)
    kept, n_inconsistent = inliers_among(without_functions(task), rows) if known_inliers is None else known_inliers
    inliers = rows.pick(kept)
    nominal, scaled = identify_kept(task, inliers, scales)
    for kind in may_join(task):
        wider = _with_residual_model(kind, task, inliers, scaled)
        if wider is not None:
            task, scales = wider
            nominal, scaled = identify_kept(task, inliers, scales)
    may_come_back = known_inliers is not None or any(isinstance(effect, ResidualModel) for effect in task.model.effects)
    while may_come_back and not kept.all():
        back = ~kept & (scaled.p_values(rows) >= OUTLIER_P)
        if not back.any():
            break
        inliers = rows.pick(kept | back)
        wider_nominal, with_them = identify_kept(task, inliers, scaled.scales)
        if unexpected(with_them.found, inliers.noisier(scaled.scales.noise)):
            break  # the better model does not explain these rows either
        kept, nominal, scaled = kept | back, wider_nominal, with_them
    there = {*scaled.found.unknowns.scaled_with, *scaled.found.unknowns.groups, OF_TYPE}
    found = Identification(
        nominal=nominal,
        identified=scaled.found,
        noise=scaled.scales.noise,
        prior_scale={name: factor for name, factor in scaled.scales.prior_scale.items() if name in there},
        used=tuple(chosen[kept].tolist()),
        outliers=tuple(chosen[~kept].tolist()),
        n_inconsistent=n_inconsistent,
    )
    if task.prior is not None or not learnt_maps(task.model):
        return found
    inliers, noise = rows.pick(kept), found.noise.copy()
    for block, _, own in inliers.parts():
        if block.of_instrument:  # what the other terms left is in the maps' σ: its points are as precise as they state
            noise[own] = np.where(block.of_length, 1.0, noise[own])
    # that noise would count a second time in the parameters: their error is in what the maps learnt
    fixed = fixed_rows(task, found.prior_scale)
    blocks, plain = [*inliers.noisier(noise).blocks, *fixed], found.identified
    plain = replace(plain, covariance=covariance_of(plain, plain.unknowns, blocks))
    return replace(found, identified=with_maps(plain, inliers), noise=noise, without_maps=found)


def _with_residual_model(
    kind: type[ResidualModel], task: Task, rows: RowBlocks, scaled: ScaledFit
) -> tuple[Task, Scales] | None:
    """`task` with a residual model of this kind, and the scales then; None where the rows do not support it."""
    if len(rows) < ROWS_AT_LEAST or not unexpected(scaled.found, rows):
        return None
    wider = with_kind(task, kind, rows)
    if wider is None:
        return None
    sample = rows.pick(sampled(rows, SEARCHED)) if len(rows) > SEARCHED else rows
    start, known = nominal_start(wider, rows), scaled.scales.factors(rows)
    scales = scales_with(kind.group, scaled.found, start, sample, fixed_rows(task), known)
    if scales is None or not _predicts_better(kind, wider, start, rows, scaled, scales):
        return None
    return wider, Scales.of(rows, scales)


def _predicts_better(
    kind: type[ResidualModel],
    task: Task,
    unknowns: Unknowns,
    rows: RowBlocks,
    scaled: ScaledFit,
    scales: Mapping[Factor, float],
) -> bool:
    """Whether held-out rows are predicted significantly better with the residual model that `task` adds to what was
    `scaled`, with these scales. The evidence alone takes any scatter for a function of the joints.
    """
    some = rows.pick(judging(len(rows)))
    begin = carried(scaled.found, unknowns)
    folded = Folded.of(
        unknowns, begin, some, fixed_rows(task), random_folds(some.q), task.registration_parameters(unknowns)
    )
    without = ~unknowns.among(frozenset({kind.group}))[unknowns.free]
    logs = [{f: float(np.log(v)) for f, v in each.items()} for each in (scaled.scales.factors(rows), scales)]
    before, after = (without, logs[0]), (np.ones_like(without), logs[1])
    gain = Gain.of(folded.predicted(*before).errors, folded.predicted(*after).errors, kind.group)
    return gain.significant and worst_end(folded, some.q, before, after) <= WORSE_AT_END


def identify_kept(task: Task, rows: RowBlocks, scales: Scales | None = None) -> tuple[Estimate, ScaledFit]:
    """Nominal registered on `rows`, and identified; every row is taken as an inlier.

    scales: where they are known, as from a fit of more rows.
    """
    nominal = registered(task, rows)
    start, *others = _starts(task, nominal, rows)
    if scales is None:
        scaled = _fit_with_estimated_scales(start, rows, fixed_rows(task))
    else:
        scaled = _fit_with(scales, start, rows, fixed_rows(task))
    if not task.has_new_tool:
        return nominal, scaled
    noisy, states = rows.noisier(scaled.scales.noise), [each.start for each in (start, *others)]
    return nominal, replace(scaled, found=with_rival_tools(scaled.found, noisy, certified_rows(task), states))


def inliers_among(task: Task, rows: RowBlocks) -> tuple[Bools, int]:
    """Which of `rows` (N,) are inliers; and the number of the others where these are too many to leave out: all rows
    are then kept.
    """
    kept = _like_sample(task, rows, sampled(rows, SEARCHED)) if len(rows) > SEARCHED else _search_inliers(task, rows)
    n_inconsistent = 0
    for _, mine, _ in [*rows.parts(), (None, slice(None), None)]:  # each block by itself, then all of them
        left_out = int(np.count_nonzero(~kept[mine]))
        if left_out > max(OUTLIERS_AT_MOST * len(kept[mine]), FEW):
            kept, n_inconsistent = _all_of(kept, mine), n_inconsistent + left_out
    return kept, n_inconsistent


def _all_of(kept: Bools, which: slice) -> Bools:
    result = kept.copy()
    result[which] = True
    return result


def _like_sample(task: Task, rows: RowBlocks, sample: Any) -> Bools:
    """Which of `rows` (N,) agree with the prediction from the inliers among `sample` (indices)."""
    of_sample = rows.pick(sample)
    kept_of_sample = _search_inliers(task, of_sample)
    _, scaled = identify_kept(task, of_sample.pick(kept_of_sample))
    kept = scaled.p_values(rows) >= OUTLYING
    kept[sample] = kept_of_sample
    return kept


def registered(task: Task, rows: RowBlocks) -> Estimate:
    """The nominal robot, tied to the measurement by `rows`."""
    plain = without_functions(task)
    unknowns = plain.unknowns(plain.start(rows))
    unknowns = unknowns.masked(plain.registration_parameters(unknowns))
    blocks = [*rows.blocks, *certified_rows(task)]
    found = estimate(replace(unknowns, pinned=_unobservable_placements(unknowns, blocks, plain.taught_mm)), blocks)
    return found if plain is task else widened(found, task.unknowns(_with_effects(found.unknowns.start, task)))


def with_tool_registered(task: Task, rows: RowBlocks) -> Estimate:
    """The robot as in its file, tied to the measurement by `rows`, and its tool found by them too."""
    of_file = replace(without_functions(task.of_nominal), groups=frozenset({"tool"}), candidates=None)
    unknowns = of_file.unknowns(of_file.start(rows))
    return estimate(unknowns.masked(of_file.free_parameters(unknowns)), [*rows.blocks, *certified_rows(of_file)])


def _with_effects(state: State, task: Task) -> State:
    """`state` of a robot with the effects of `task`, all amounts 0."""
    models = [model.with_effects(task.model.effects) for model in state.models]
    own = [session.own for session in task.sessions[1:]]
    return State.of_sessions(models, own, state.points, state.datums)


def nominal_start(task: Task, rows: RowBlocks) -> Unknowns:
    """What `task` identifies, expected where nominal is registered on `rows`."""
    return _starts(task, registered(task, rows), rows)[0]


def _starts(task: Task, nominal: Estimate, rows: RowBlocks) -> list[Unknowns]:
    """The unknowns to identify, with nominal as registered as expected values; in partial work, new ones start where
    `rows` fit best, the most probable place first; those unobservable in registration stay there.
    """
    start = task.identification_start(rows) if task.is_partial_update else nominal.state
    unknowns = replace(task.unknowns(start), pinned=nominal.unknowns.pinned)
    unknowns = unknowns.masked(task.free_parameters(unknowns))
    if (
        task.is_partial_update and task.free_groups >= PLACED and not task.has_new_tool
    ):  # registration had not both of them free
        unknowns = replace(unknowns, pinned=_unobservable_placements(unknowns, [*rows.blocks, *certified_rows(task)]))
    if not task.has_new_tool:
        return [unknowns]
    return [unknowns.restarted(state) for state in initial_states(unknowns, rows, certified_rows(task))]


def _unobservable_placements(unknowns: Unknowns, blocks: Sequence[Rows], taught: float = np.inf) -> Floats:
    """Combinations (H, P) of free base and tool that are unobservable in the rows, in units of the unknowns' σ.

    With one orientation in all rows, a longer tool acts like a base further in. Rounded joints cause small differences,
    lost in the geometry's own errors; if it is free, the fit diverges by metres.

    taught: 1 σ, mm, of the tool's place beforehand. A direction along which rows and tolerances leave more of the tool
    open than that is held too, as uncertain as it was taught: otherwise the noise of the joints moves the tool there.
    A combination of singular value s has 1 σ of 1/s, which moves the tool by `moved`/s mm.
    """
    if not (unknowns.free & unknowns.among(frozenset({"base", "tool"}))).any():
        return np.zeros((0, len(unknowns.names)))
    known = unknowns.among(frozenset({"datums"})) & (unknowns.sigma < FLAT)  # its prior holds it, not a pin
    unknowns = unknowns.masked(~known)
    _, singular, right = np.linalg.svd(triangle_with_model_error(unknowns, blocks))
    places = np.array([each.group == "tool" and not each.turns for each in unknowns.parameters])[unknowns.free]
    moved = np.linalg.norm(right[:, places] * unknowns.sigma[unknowns.free][places], axis=1)  # mm of the tool
    invisible, weak = singular < INVISIBLE, moved > taught * singular
    scale = np.where(invisible, 1.0, moved / taught)  # see `Unknowns.pinned`
    unseen = (right * scale[:, None])[invisible | weak]
    result = np.zeros((len(unseen), len(unknowns.names)))
    result[:, unknowns.free] = unseen
    return result


def certified_rows(task: Task) -> list[Rows]:
    """Certified distances, which are never outliers."""
    return [task.spacings] if task.spacings is not None else []


def fixed_rows(task: Task, prior_scale: Mapping[Group, float] | None = None) -> list[Rows]:
    """All that is fitted besides the rows: certified distances, and what the robot's type tells. The latter is no
    measurement of this robot: it makes nothing observable, and registers nothing.
    """
    return [*certified_rows(task), *_widened([task.type_rows] if task.type_rows else [], prior_scale or {})]


def _widened(blocks: Sequence[Rows], prior_scale: Mapping[Group, float]) -> list[Rows]:
    """`blocks`, those of a type with their σ as the evidence scales it."""
    factor = prior_scale.get(OF_TYPE, 1.0)
    return [block.noisier(factor) if isinstance(block, TypeRows) else block for block in blocks]


def _search_inliers(task: Task, rows: RowBlocks) -> Bools:
    """Which rows (N,) are inliers: found about the fit of the inliers, repeated until they stay the same.

    All rows, where these are too few to check each other.
    """
    if rows.size < OVERDETERMINED * task.n_registration:
        return np.ones(len(rows), bool)
    start = _starts(task, _registered_on_closest(task, rows), rows)[0]
    start = start.masked(~start.among(functions()))  # hundreds of amounts that hide no outlier are held
    unknowns, deviations, noise = start, np.zeros(len(start.names)), np.ones(len(rows.quantities))
    scale: Mapping[Group, float] = {}
    before = None
    for _ in range(ROUNDS):
        balanced = rows.noisier(noise / noise.min())
        linear = Linear.about(unknowns, deviations, balanced, _widened(fixed_rows(task), scale))
        kept = find_inliers(linear, thorough=before is not None).kept  # nominal is too far from the rows for that
        if before is not None and np.array_equal(kept, before):
            break
        scaled = _fit_with_estimated_scales(start, rows.pick(kept), fixed_rows(task), deviations)
        scale = scaled.scales.prior_scale
        unknowns, deviations, noise = scaled.found.unknowns, scaled.found.deviations, scaled.scales.noise
        before = kept
    return kept


def _registered_on_closest(task: Task, rows: RowBlocks) -> Estimate:
    """Nominal registered on the share of rows that is nearest to it: outliers do not affect the start."""
    nominal, share = registered(task, rows), max(int(CLOSEST * len(rows)), task.rows_at_least)
    before: Any = None
    for _ in range(ROUNDS):
        closest = np.sort(np.argsort(rows.errors(nominal.state), kind="stable")[:share])
        if np.array_equal(closest, before):
            break
        some = [*rows.pick(closest).blocks, *certified_rows(task)]
        nominal, before = estimate(nominal.unknowns, some, nominal.deviations), closest
    return nominal


def _fit_with_estimated_scales(
    unknowns: Unknowns, rows: RowBlocks, others: Sequence[Rows], begin: Floats | None = None
) -> ScaledFit:
    """The fit, repeated with noise and tolerances from the evidence of its residuals until these settle."""
    result = _fit_with(Scales.as_stated(rows), unknowns, rows, others, begin)
    if not estimated(unknowns) and not unexpected(result.found, rows) and not unlike_its_type(result.found, others):
        return result
    sample = rows.pick(sampled(rows, SEARCHED)) if len(rows) > SEARCHED else rows
    for _ in range(SCALINGS):
        before, scales = result, Scales.of(rows, factors(result.found, unknowns, sample, others))
        result = _fit_with(scales, unknowns, rows, others, before.found.deviations)
        if scales.settled(before.scales):
            break
    return result


def _fit_with(
    scales: Scales, unknowns: Unknowns, rows: RowBlocks, others: Sequence[Rows], begin: Floats | None = None
) -> ScaledFit:
    blocks = [*rows.noisier(scales.noise).blocks, *_widened(others, scales.prior_scale)]
    return ScaledFit(_fit(unknowns.with_prior_scale(scales.prior_scale), blocks, begin), scales)


def _noise(rows: RowBlocks, grown: Mapping[Factor, float]) -> Floats:
    """The factor of each of the rows' quantities; those of one kind in one block share theirs."""
    result = np.ones(len(rows.quantities))
    for block, _, own in rows.parts():
        for quantity in dict.fromkeys(block.quantities):
            mine = np.array(block.quantities) == quantity
            result[own][mine] = grown.get(("noise", own.start + int(np.argmax(mine))), 1.0)
    return result


def _fit(unknowns: Unknowns, blocks: Sequence[Rows], begin: Floats | None = None) -> Estimate:
    """The fit; amounts that would fall below their effect's lower bound are held there, with their uncertainty from
    before, as if there were no bound. An amount that is held once is not released again.
    """
    found, held = estimate(unknowns, blocks, begin), np.zeros(len(unknowns.names), bool)
    while (below := unknowns.free & ~held & (found.deviations < unknowns.least)).any():
        held = held | below
        at_least = unknowns.restarted(unknowns.state(np.where(held, unknowns.least, 0.0))).masked(~held)
        found = estimate(at_least, blocks)
    if not held.any():
        return found
    return replace(found, covariance=covariance_of(found, replace(found.unknowns, free=unknowns.free), blocks))
