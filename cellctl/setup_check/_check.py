"""The set-up check: whether nominal is too far from the rows for any robot, and the ranking of what explains it.

Nothing is repaired. A correct set-up costs one registration. Hypotheses are tried only if nominal, registered, is
further from the nearest 60 % of its rows than three times the prediction of the tolerances; those with an angle to fit
only from six times on. A hypothesis is accepted if it leaves at most three times the prediction, and at most a quarter
of the error before.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias, final

import numpy as np

from cellctl.calibration.identification.progress import Progress, silent
from cellctl.calibration.problem.task import Task
from cellctl.kinematics import Floats, JointMap
from cellctl.setup_check._mixed_units import mixed_units
from cellctl.setup_check._row_order import count_outliers, out_of_step, put_in_step
from cellctl.setup_check._signs_and_zeros import offset_joint, plain_joints, reversed_joint, three_joints, two_joints
from cellctl.setup_check._units_and_conventions import (
    metres,
    other_convention,
    other_hand,
    other_length,
    other_orientations,
    other_spheres,
    other_unit,
    swapped_columns,
)
from cellctl.setup_check._wide_fit import WideFit
from cellctl.setup_check.hypothesis import Change, Hypothesis, Setup
from cellctl.setup_check.misfit import (
    CORE,
    EXPLAINED,
    LEAST_MM,
    SAMPLE,
    SCREEN,
    SUSPICIOUS,
    Misfit,
    distances,
    misfit,
    rms,
    steps_of,
)

BETTER = 4.0
"""A hypothesis has to bring nominal nearer to its rows by this factor."""

EQUAL = 1.5
"""Hypotheses with up to this multiple of the best one's residual are equally good: these rows do not decide."""

FLAT = 0.05
"""Touches on planes whose least extent is smaller than this share of their greatest lie in one plane."""

SAME_DEG = 2.0
"""Offsets nearer than this to each other are one."""

PROMISING = 8
"""Most hypotheses that are judged, selected by a few rows."""

NAMED = 4
"""Most explanations that are reported."""

Stage: TypeAlias = Callable[[Setup], Iterator[Hypothesis]]
"""Proposes hypotheses about a set-up."""

ROWS_AT_LEAST = 8
OUTLIERS_AT_LEAST = 2

MISPLACED_MM = 100.0
"""If spheres are further than this from their rough places, the unit of the readings is checked."""


@final
@dataclass(frozen=True, slots=True)
class SetupError:
    """Changes that together bring nominal to the rows; RMS over the nearest rows before and after.

    unit: `mm`, or `°` where the orientations were wrong.
    """

    changes: tuple[Change, ...]
    before: float
    after: float
    unit: str

    @property
    def evidence(self) -> str:
        """`RMS 214 → 0.9 mm`."""
        return f"RMS {_figure(self.before)} → {_figure(self.after)} {self.unit}".replace(" °", "°")

    def words(self, name: Callable[[int], str] = "row {}".format) -> str:
        """`A3 reversed: RMS 214 → 0.9 mm`; rows are called by `name`."""
        return f"{', '.join(change.words(name) for change in self.changes)}: {self.evidence}"


@final
@dataclass(frozen=True, slots=True)
class SetupCheck:
    """What was found. errors: alternative explanations, the best first; each alone is sufficient.

    implausible: whether nominal is too far from the rows for any robot of its kind. wide_fit: if nominal is suspicious
    and no set-up error explains that, the result of a fit within wide tolerances. left_out: the rows that this check
    cannot judge, by kind, as "200 heights".
    """

    implausible: bool = False
    errors: tuple[SetupError, ...] = ()
    wide_fit: WideFit | None = None
    left_out: tuple[str, ...] = ()


def check_setup(task: Task, joints: JointMap, readings: Floats, progress: Progress = silent) -> SetupCheck:
    """Set-up errors in `task`, whose rows were read at controller readings (M, n), deg, through `joints`.

    Equally good explanations are all reported: the rows do not show which is right. Nothing is found where
    there are too few rows, or where nominal cannot be registered numerically.
    """
    judged = np.concatenate([np.full(len(block), block.in_setup_check) for block in task.rows.blocks])
    if not judged.all():
        others = {block.many: len(block) for block in task.rows.blocks if len(block) and not block.in_setup_check}
        known = replace(task, rows=task.rows.pick(judged))
        found = check_setup(known, joints, np.asarray(readings, float)[judged], progress)
        return replace(found, left_out=tuple(f"{count} {name}" for name, count in others.items()))
    if len(task.rows) < ROWS_AT_LEAST or task.rows.size < 2 * task.n_registration:
        return SetupCheck()
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            return _checked(Setup(task, joints, np.asarray(readings, float)), progress)
    except np.linalg.LinAlgError:
        return SetupCheck()


def _checked(setup: Setup, progress: Progress) -> SetupCheck:
    sample = setup.thinned(SAMPLE)
    nominal = misfit(sample).with_prediction(sample)
    outliers = count_outliers(setup, nominal) >= OUTLIERS_AT_LEAST
    stages = _stages(setup, nominal)
    found = _of_some_rows(setup, mixed_units(setup)) if nominal.suspicious or outliers else []
    if not found and stages:
        found = _of_all_rows(setup, nominal, stages, progress)
    elif not found and outliers:
        found = _of_some_rows(setup, put_in_step(setup, nominal))
    found = found or list(_misplaced(sample, nominal))
    wide_fit = None
    if not found and nominal.far_mm(SUSPICIOUS):
        progress("whether robot file and data belong together", 0.9)
        wide_fit = WideFit.of(sample)
    return SetupCheck(nominal.implausible, tuple(found), wide_fit)


def _stages(setup: Setup, nominal: Misfit) -> tuple[Stage, ...]:
    """The hypotheses worth trying, simple ones first; none for a correct set-up."""
    if nominal.implausible and nominal.far_mm(SUSPICIOUS):
        return _simple, out_of_step, offset_joint, _two_kinds, two_joints, three_joints
    if nominal.far_mm(SUSPICIOUS):
        return _simple, out_of_step
    if nominal.suspicious:
        return (_of_orientations,)
    # touched from one side, another sphere size has nearly the same effect as another place
    return (other_spheres,) if nominal.mm > LEAST_MM and setup.task.rows.has_distances else ()


def _of_orientations(sample: Setup) -> Iterator[Hypothesis]:
    """Hypotheses that do not change positions."""
    yield from other_orientations(sample)
    yield from other_hand(sample)


def _of_one_kind(setup: Setup) -> Iterator[Hypothesis]:
    for propose in (other_unit, other_length, other_hand, other_spheres, other_convention, metres):
        yield from propose(setup)


def _simple(sample: Setup) -> Iterator[Hypothesis]:
    yield from _of_one_kind(sample)
    yield from swapped_columns(sample)
    yield from plain_joints(sample)


def _two_kinds(sample: Setup) -> Iterator[Hypothesis]:
    """Two errors of different kinds: a unit, a hand, a convention, and another of these, or a joint."""
    for first in _of_one_kind(sample):
        for second in (*_of_one_kind(first.setup), *reversed_joint(first.setup)):
            if second.changes[0].key != first.changes[0].key:
                changes = (*first.changes, *second.changes)
                yield Hypothesis(changes, second.setup, 20 + first.complexity + second.complexity)


def _of_all_rows(setup: Setup, nominal: Misfit, stages: tuple[Stage, ...], progress: Progress) -> list[SetupError]:
    """Explanations of all rows at once; two or three joints only where no simpler one is found. None where small
    offsets of joint zeros explain the rows as well: the identification finds them.
    """
    sample = setup.thinned(SAMPLE)
    for number, stage in enumerate(stages):
        progress("set-up errors", 0.9 * number / len(stages))
        found = explanations(stage(setup if stage is out_of_step else sample), nominal)
        if found:
            mastering = any(hypothesis.mastering for hypothesis, _ in found)
            return [] if mastering else [_error(hypothesis, nominal, after) for hypothesis, after in found]
    return []


def _error(hypothesis: Hypothesis, before: Misfit, after: Misfit) -> SetupError:
    if before.mm < BETTER * after.mm:
        return SetupError(hypothesis.changes, before.deg, after.deg, "°")
    return SetupError(hypothesis.changes, before.mm, after.mm, "mm")


def _of_some_rows(setup: Setup, proposed: Iterable[Hypothesis]) -> list[SetupError]:
    """Errors of some rows alone, with RMS over these rows where nominal is registered on all rows together."""
    found = []
    for hypothesis in proposed:
        state = misfit(hypothesis.setup.thinned(SAMPLE)).state
        plain, changed = (distances(each, state) for each in (setup, hypothesis.setup))
        before, after = (mm[plain != changed] for mm in (plain, changed))
        nearest = np.sort(after)[: max(int(CORE * len(after)), 1)]
        found.append(SetupError(hypothesis.changes, rms(before), rms(nearest), "mm"))
    return found


def _misplaced(sample: Setup, nominal: Misfit) -> Iterator[SetupError]:
    """Readings in another unit where only points are measured: a TCP that hardly moves fits a sphere of any size, but
    not the sphere's rough place. RMS of the distances from the rough places.
    """
    rough = sample.task.rough
    if rough is None or not np.all(np.isfinite(rough)) or sample.task.rows.has_positions:
        return
    before = rms(np.linalg.norm(nominal.state.points - rough, axis=1))
    for hypothesis in other_unit(sample) if before > MISPLACED_MM else ():
        after = misfit(hypothesis.setup).with_prediction(hypothesis.setup)
        nearer = rms(np.linalg.norm(after.state.points - rough, axis=1))
        if after.ratio <= EXPLAINED and before >= BETTER * nearer:
            yield SetupError(hypothesis.changes, before, nearer, "mm")


def _figure(value: float) -> str:
    """Two significant figures at least, three for large ones, no exponent."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}" if value >= 1.0 else f"{value:.2g}"


def explanations(proposed: Iterable[Hypothesis], nominal: Misfit) -> list[tuple[Hypothesis, Misfit]]:
    """The hypotheses that explain the distance of `nominal` from the rows, with the misfit that each leaves. The best
    and its equals, the simplest first.
    """
    explaining = []
    for hypothesis in _screened(proposed, nominal):
        sample = hypothesis.setup.thinned(SAMPLE)
        after = misfit(sample).with_prediction(sample)
        if after.ratio <= EXPLAINED and nominal.ratio >= BETTER * after.ratio:
            explaining.append((hypothesis, after))
    return _equally_good(explaining)


def _screened(proposed: Iterable[Hypothesis], nominal: Misfit) -> list[Hypothesis]:
    """Those with the least residual at a few rows, of all that clearly reduce it."""
    sized = []
    for hypothesis in proposed:
        size = misfit(hypothesis.setup.thinned(SCREEN), rounds=2).size
        if size < nominal.size / 2.0 and not _flat(hypothesis):
            sized.append((size, hypothesis))
    steps = steps_of(np.array([size for size, _ in sized]))
    order = sorted(range(len(sized)), key=lambda place: (steps[place], sized[place][1].complexity, place))
    return [sized[place][1] for place in order[:PROMISING]]


def _flat(hypothesis: Hypothesis) -> bool:
    """Whether only planes were touched, and all touches lie in one plane: a robot that only moves in a plane fits any
    planes, and would explain all rows.
    """
    task = hypothesis.setup.task
    if not all(kind.of_planes for kind in task.rows.kinds):
        return False
    tcps = np.concatenate([task.model.tcp(block.postures) for block in task.rows.blocks])
    extents = np.linalg.svd(tcps - tcps.mean(axis=0), compute_uv=False)
    return bool(extents[-1] < FLAT * extents[0])


def _equally_good(explaining: list[tuple[Hypothesis, Misfit]]) -> list[tuple[Hypothesis, Misfit]]:
    """The best and its equals, the simplest first; for each file only those with the fewest changes."""
    best = min((after.size for _, after in explaining), default=0.0)
    equal = [(hypothesis, after) for hypothesis, after in explaining if after.size <= EQUAL * best]
    kept: list[tuple[Hypothesis, Misfit]] = []
    for hypothesis, after in sorted(equal, key=lambda pair: (pair[0].complexity, pair[1].size)):
        if not any(_simpler(other, hypothesis) or _same(hypothesis, other) for other, _ in kept):
            kept.append((hypothesis, after))
    return kept[:NAMED]


def _simpler(other: Hypothesis, hypothesis: Hypothesis) -> bool:
    """Whether `other` makes fewer changes, in no other file, or the same changes in a simpler way."""
    if _keys(other) == _keys(hypothesis) and other.complexity < hypothesis.complexity:
        return True
    sources = {change.source for change in hypothesis.changes}
    return {change.source for change in other.changes} <= sources and len(other.changes) < len(hypothesis.changes)


def _same(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses are the same, except for the exact value of an angle."""
    if _keys(one) != _keys(other):
        return False
    apart = np.abs((one.setup.joints.offset - other.setup.joints.offset + 180.0) % 360.0 - 180.0)
    words = [[re.sub(r"[\d.]+°", "", change.what) for change in each.changes] for each in (one, other)]
    return words[0] == words[1] and bool(np.all(apart < SAME_DEG))


def _keys(hypothesis: Hypothesis) -> list[tuple[str | int, ...]]:
    return [change.key for change in hypothesis.changes]
