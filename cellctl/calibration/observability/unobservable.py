"""Unobservable combinations of parameters, in words (`tool translation along X, Y`), with their reasons.

R is the triangle of the rows' Jacobian alone, columns in tolerances (JᵀJ = RᵀR). Its singular value s of a unit vector
v is ‖R v‖: by how many standard deviations one tolerance of the combination v moves all rows together. Below
`OBSERVABLE_SIGMAS` it is unobservable: the prior holds it. The right singular vectors of these span a subspace, but any
rotation of them does as well, and a vector of 24 numbers is no reason: `_sparse_combinations` looks for a basis of few
parameters each.

A reason is a change of the rows (a joint that moves, another approach, a length) whose Jacobian L is known: a
combination v belongs to the first reason for which ‖L v‖ is at least `OBSERVABLE_SIGMAS`, and `SHOWN` times what the
rows show.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import scipy.linalg

from cellctl.calibration.model.parameter import FRAMES, Group, Parameter, Phrase
from cellctl.calibration.model.unknowns import Unknowns
from cellctl.calibration.observability.reasons import Rowed, any_posture, reasons_for
from cellctl.calibration.solver.estimate import Estimate
from cellctl.kinematics import Bools, Floats

_WITH = " with "
_NUMBER = re.compile(r"\d+")
_FIRST = ("tool", "base")
_LAST = ("points", "datums")
_PLACEMENTS = frozenset({*FRAMES, "points", "datums"})


def in_words(parameters: Sequence[Parameter]) -> list[str]:
    """The parameters as phrases, similar ones joined: links, tool, base, effects, points, zeros of lengths."""
    items: dict[tuple[int, str, int, Phrase], list[str]] = {}
    for each in parameters:
        owner = each.session if each.group in _FIRST else ""
        items.setdefault((_rank(each), owner, each.phrase.part, each.phrase), []).append(each.item)
    places = list(dict.fromkeys((rank, owner) for rank, owner, _, _ in items))
    ordered = sorted(items, key=lambda key: (key[0], places.index(key[:2]), key[2]))
    return [key[-1].of_items(items[key]) for key in ordered]


def _rank(parameter: Parameter) -> int:
    if parameter.of_the_arm:
        return 0
    if parameter.group in _FIRST:
        return 1 + _FIRST.index(parameter.group)
    return 4 + _LAST.index(parameter.group) if parameter.group in _LAST else 3


def phrases(combinations: Sequence[Sequence[Parameter]], most: int | None = None) -> list[str]:
    """`θ2 with a2, α3` of each combination of parameters, with `and 24 others` beyond `most` phrases; single parameters
    in one phrase, last: `θ5; d5; backlash of joints 1, 2: each alone`.
    """
    phrases = [in_words(parameters) for parameters in combinations]
    alone = [each for own, parts in zip(combinations, phrases, strict=True) if len(parts) == 1 for each in own]
    found = [f"{parts[0]}{_WITH}{_cut(parts[1:], most)}" for parts in phrases if len(parts) > 1]
    parts = in_words(list(dict.fromkeys(alone)))
    several = len(alone) > 1
    return [*found, f"{'; '.join(parts)}{': each' if several else ''} alone"] if parts else found


def alike(phrases: Sequence[str]) -> list[str]:
    """Phrases with the same other parameters joined, and those that differ by one number alone: `θ7, d7 each with tool
    translation along X`; `d of link i with growth of link i, i = 3, 5`.
    """
    heads: dict[str, list[str]] = {}
    for phrase in phrases:
        head, _, others = phrase.partition(_WITH)
        heads.setdefault(others, []).append(head)
    shorter = [_headed(first, others) for others, first in heads.items()]
    forms: dict[str, list[str]] = {}
    for phrase in shorter:
        numbers = _NUMBER.findall(phrase)
        forms.setdefault(_NUMBER.sub("i", phrase) if len(set(numbers)) == 1 else phrase, []).append(phrase)
    return [_numbered(form, same) for form, same in forms.items()]


def _headed(heads: list[str], others: str) -> str:
    if not others:
        return "; ".join(heads)
    return f"{', '.join(heads)}{' each' if len(heads) > 1 else ''}{_WITH}{others}"


def _numbered(form: str, same: list[str]) -> str:
    if len(same) == 1:
        return same[0]
    return f"{form}, i = {', '.join(sorted((_NUMBER.findall(phrase)[0] for phrase in same), key=int))}"


def _cut(parts: list[str], most: int | None) -> str:
    if most is None or len(parts) <= most:
        return ", ".join(parts)
    return f"{', '.join(parts[: most - 1])} and {len(parts) - most + 1} others"


SHORT = 4
"""Phrases of one combination on a screen."""

OBSERVABLE_SIGMAS = 0.1
"""A combination is observable if one tolerance of it changes all rows together by this many standard deviations or
more: they then take s²/(1 + s²) = 1 % off its prior variance."""

NO_EFFECT = 1e-9
"""An effect on the rows below this share of the largest one is rounding."""

SHOWN = 3.0
"""Rows without a reason show what it hides at least this many times as strongly as the real rows: any change of
postures shows a weak combination a little better, which is no reason."""

UNTOLD = "these rows cannot tell these apart, others would"
ANYWHERE = "no measurement of these kinds can tell these apart, or depends on them"
"""Reason for base placement, and for the mounting of the tool on the last link."""


@final
@dataclass(frozen=True, slots=True)
class Hidden:
    """What one reason hides. reason: `joint 3 never moves in these rows`. combinations: the parameters of each; the
    rows determine only their joint effect. harmless: no rows of these kinds could separate them at any posture.
    """

    reason: str
    combinations: tuple[tuple[Parameter, ...], ...]
    harmless: bool = False

    def phrases(self, most: int | None = None) -> list[str]:
        """The combinations in words, similar ones joined; of more than `most` parameters each `and 24 others`."""
        return alike(phrases(self.combinations, most))

    def summary(self) -> dict[str, Any]:
        """As plain values for JSON; `short`: the words for a screen."""
        return {
            "cause": self.reason,
            "harmless": self.harmless,
            "combinations": [[parameter.name for parameter in parts] for parts in self.combinations],
            "words": self.phrases(),
            "short": self.phrases(SHORT),
        }


@final
@dataclass(frozen=True, slots=True)
class Observability:
    """Observability of the free parameters in the data.

    rank: number of observable combinations; unseen: the others, in words, single parameters in one phrase; singular
    (F,): by how many standard deviations one tolerance of each combination changes the rows, largest first. hidden: the
    same by reason, those that hide most first, harmless ones last.
    """

    rank: int
    unseen: tuple[str, ...]
    singular: tuple[float, ...]
    hidden: tuple[Hidden, ...] = ()


def observability(estimate: Estimate, triangle: Floats | None = None, rows: Rowed | None = None) -> Observability:
    """Rank and unseen combinations of a fit, from its data alone (no tolerance helps).

    triangle: in place of the fit's own, as `estimate.triangle_at_start` gives it: at the solution, errors of an
    identified geometry can make combinations formally observable that are below the noise. rows: those of the fit,
    where reasons are needed. Parameters of a session or a point without rows in the fit are not combinations: they get
    their own reason.
    """
    triangle = estimate.triangle if triangle is None else triangle
    free = np.flatnonzero(estimate.unknowns.free)
    effect = np.linalg.norm(triangle, axis=0)
    owners = _owners(estimate.unknowns)[free]
    nothing = effect <= NO_EFFECT * effect.max(initial=0.0)
    there = ~np.isin(owners, sorted(set(owners[nothing]) - set(owners[~nothing]) - {""}))
    parameters = [estimate.unknowns.parameters[index] for index in free[there]]
    _, singular, right = np.linalg.svd(triangle[:, there])
    rank = int(np.sum(singular >= OBSERVABLE_SIGMAS))
    combined = _sparse_combinations(right[rank:], effect[there], parameters)
    strong = [_strong(parameters, each) for each in combined * _floored(effect[there])]
    away = [Hidden(f"no row of the fit belongs to {owner}", ()) for owner in dict.fromkeys(owners[~there].tolist())]
    hidden = _by_cause(rows, _widened(combined, there), strong) if rows else []
    return Observability(rank, tuple(phrases(strong)), tuple(float(value) for value in singular), (*hidden, *away))


def _owners(unknowns: Unknowns) -> Any:
    """Owner of each parameter (P,), in words: a session with its own base or tool, a fixed point, the zero of a length;
    empty for the robot's.
    """
    apart = {parameter.group for parameter in unknowns.parameters if parameter.session}
    return np.array([_owner(parameter, apart) for parameter in unknowns.parameters])


def _owner(parameter: Parameter, apart: Collection[Group]) -> str:
    """apart: which of base and tool later sessions have as their own, so that the first session's belong to it."""
    if parameter.session:
        return f"session {parameter.session}"
    return parameter.owner or ("the first session" if parameter.group in apart else "")


def _widened(combined: Floats, there: Bools) -> Floats:
    """Combinations (U, F) of all free parameters, from those of the ones that are `there`."""
    result = np.zeros((len(combined), len(there)))
    result[:, there] = combined
    return result


def _by_cause(rows: Rowed, combined: Floats, strong: list[tuple[Parameter, ...]]) -> list[Hidden]:
    """Each combination (U, F) under the first reason without which the rows would show it."""
    left = np.ones(len(combined), bool)
    least = np.maximum(OBSERVABLE_SIGMAS, SHOWN * _sizes(rows.as_they_are(), combined)) if left.any() else left
    found: list[Hidden] = []
    for reason in reasons_for(rows) if left.any() else ():
        mine = left & (_sizes(reason.lines(), combined) >= least)
        if reason.of_frames:
            mine &= [not all(each.of_the_arm for each in parts) for parts in strong]
        left &= ~mine
        found += [Hidden(reason.words, _picked(strong, mine))] if mine.any() else []
    found.sort(key=lambda hidden: -len(hidden.combinations))
    if left.any():
        untold = left & (_sizes(any_posture(rows), combined) >= least)
        never = left & ~untold
        found += [Hidden(UNTOLD, _picked(strong, untold))] if untold.any() else []
        found += [Hidden(ANYWHERE, _picked(strong, never), harmless=True)] if never.any() else []
    return found


def _sizes(moves: Floats, combined: Floats) -> Floats:
    """By how many standard deviations each combination (U, F) moves rows (K, F) together."""
    return np.asarray(np.linalg.norm(moves @ combined.T, axis=0))


def _picked(strong: list[tuple[Parameter, ...]], which: Bools) -> tuple[tuple[Parameter, ...], ...]:
    return tuple(each for each, mine in zip(strong, which, strict=True) if mine)


def _sparse_combinations(unseen: Floats, effect: Floats, parameters: list[Parameter]) -> Floats:
    """The unseen subspace (U, F), in tolerances, in a basis of few parameters each.

    Pivoted QR picks U main parameters of the subspace by their shares of effect on the rows (F,); each basis vector
    holds one of them, none of the others. Links' parameters are picked before effects', and these before tool, base and
    centres: `θ1 with base rotation`, not the reverse. Harmless combinations are not mixed with others.
    """
    if not len(unseen):
        return unseen
    shares = unseen * _floored(effect)
    preference = np.array([_preference(parameter) for parameter in parameters])
    _, _, pivots = scipy.linalg.qr(shares * preference, pivoting=True, mode="economic")
    chosen = np.sort(pivots[: len(unseen)])
    basis = np.linalg.lstsq(shares[:, chosen].T, np.eye(len(chosen)), rcond=None)[0].T @ unseen
    return np.asarray(basis / np.linalg.norm(basis, axis=1, keepdims=True))


def _preference(parameter: Parameter) -> float:
    """Factor on a parameter's column in the pivoting: a link is preferred to an effect of up to ten times its share."""
    if parameter.of_the_arm:
        return 100.0
    return 1.0 if parameter.group in _PLACEMENTS else 10.0


def _floored(effect: Floats) -> Floats:
    """Effects (F,), each above 0."""
    return np.asarray(np.maximum(effect, 1e-12 * max(float(effect.max(initial=0.0)), 1e-300)))


def _strong(parameters: list[Parameter], shares: Floats) -> tuple[Parameter, ...]:
    """The parameters with a tenth or more of the greatest share."""
    return tuple(parameters[index] for index in np.flatnonzero(np.abs(shares) >= 0.1 * np.max(np.abs(shares))))


INFORMED = 0.8
"""Rows have determined a combination of parameters if at most this share of its variance is left. For a model from 80
positions that takes 10 more, for one from 200 about 30.
"""

ROUNDING = 1e-9
"""Variances (scaled) below this share of the greatest one are rounding."""


def informed(found: Estimate) -> bool:
    """Whether the rows of a fit determined any combination of the robot's own parameters: links, zeros, effects.

    Base, tool, points and datums are placements: rows that determine only these do not improve the robot's own model.
    Without a prior covariance, the tolerances are the prior.
    """
    unknowns = found.unknowns
    mine = unknowns.free & ~np.isin(unknowns.groups, list(_PLACEMENTS))
    if not mine.any():
        return False
    columns = np.flatnonzero(mine)
    before = unknowns.known(columns)
    after = found.covariance[np.ix_(columns, columns)] / np.outer(unknowns.sigma[columns], unknowns.sigma[columns])
    return bool(min(_shares(before, after)) <= INFORMED)


def _shares(before: Floats, after: Floats) -> Sequence[float]:
    """Share left of the variance of each combination (generalised eigenvalues of `after` in `before`, (P, P))."""
    values, vectors = np.linalg.eigh(before)
    known = values > ROUNDING * values.max()
    root = vectors[:, known] / np.sqrt(values[known])
    return [float(share) for share in np.linalg.eigvalsh(root.T @ after @ root)]
