"""Set-up mistakes: whether nominal is too far from the rows for any robot, and which supposition brings it back.

Nothing is repaired. A healthy set costs one registration: suppositions are looked at only where nominal, registered, is
further from the nearest 60 % of its rows than three times what tolerances foresee, and those with an angle to fit only
from six times on. One counts when what it leaves is at most three times what is foreseen, and at most a quarter of what
there was.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeAlias, final

import numpy as np

from cellctl.calibration.estimation.progress import Progress, silent
from cellctl.calibration.estimation.task import Task
from cellctl.calibration.mistakes.case import Case
from cellctl.calibration.mistakes.columns import other_unit, swapped_columns
from cellctl.calibration.mistakes.joints import offset_joint, plain_joints, reversed_joint, three_joints, two_joints
from cellctl.calibration.mistakes.measured import other_hand, other_length, other_spheres
from cellctl.calibration.mistakes.misfit import (
    CORE,
    EXPLAINED,
    IMPLAUSIBLE,
    LEAST_MM,
    SUSPICIOUS,
    Misfit,
    misfit,
    rms,
    row_errors,
    steps_of,
)
from cellctl.calibration.mistakes.mixed_units import mixed_units
from cellctl.calibration.mistakes.order import out_of_step, put_in_step, wild_rows
from cellctl.calibration.mistakes.plausibility import WideFit
from cellctl.calibration.mistakes.supposition import Change, Supposition
from cellctl.calibration.mistakes.table import metres, other_convention
from cellctl.calibration.mistakes.turns import other_turns
from cellctl.calibration.rows import PlaneRows, PoseRows, PositionRows, TouchRows
from cellctl.kinematics import Floats, JointMap

Stage: TypeAlias = Callable[[Case], Iterator[Supposition]]
"""Poses suppositions about a case."""

SAMPLE = 150
"""Rows that judge a supposition."""

SCREEN = 60
"""Rows that say which suppositions are worth judging."""

BETTER = 4.0
"""A supposition has to bring nominal this many times nearer to its rows."""

EQUAL = 1.5
"""Suppositions that leave up to this many times what the best one leaves are as good: nothing in these rows decides."""

FLAT = 0.05
"""Touches on planes whose least extent is smaller than this share of their greatest lie in one plane."""

SAME_DEG = 2.0
"""Offsets nearer than this to each other are one."""

PROMISING = 8
NAMED = 4

ROWS_AT_LEAST = 8
WILD = 2

MISPLACED_MM = 100.0
"""Spheres that are found further than this from where they roughly are raise the question of the readings' unit."""


@final
@dataclass(frozen=True, slots=True)
class Mistake:
    """Changes that, made together, bring nominal to the rows; RMS over the nearest rows before and after.

    unit: `mm`, or `°` where orientations are what was wrong.
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
class SetUp:
    """What was found. implausible: whether nominal is too far from the rows for any robot of its kind; rms_mm,
    foreseen_mm: how far, and what tolerances foresee. mistakes: explanations, best first; any one of them explains all.
    wide_fit: where nothing explains it, what a fit within wide tolerances leaves.
    """

    implausible: bool
    rms_mm: float
    foreseen_mm: float
    mistakes: tuple[Mistake, ...] = ()
    wide_fit: WideFit | None = None


NOTHING = SetUp(False, 0.0, 0.0)
"""Nothing was found, or there was nothing to find it by."""


def find_mistakes(task: Task, joints: JointMap, readings: Floats, progress: Progress = silent) -> SetUp:
    """Mistakes of set-up in `task`, whose rows were read at controller readings (M, n), deg, through `joints`.

    Where several explanations leave as little, all are named: the rows cannot tell which it is. Rows on which nominal
    cannot be registered numerically accuse nobody.
    """
    if len(task.rows) < ROWS_AT_LEAST or task.rows.size < 2 * task.registering:
        return NOTHING
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            return _searched(Case(task, joints, np.asarray(readings, float)), progress)
    except np.linalg.LinAlgError:
        return NOTHING


def _searched(case: Case, progress: Progress) -> SetUp:
    few = case.thinned(SAMPLE)
    nominal = misfit(few).foreseen(few)
    stages = _stages(case, nominal)
    found = list(_some_rows(case, mixed_units(case))) if nominal.suspicious or _wild(case, nominal) else []
    if not found:
        found = _explained(case, nominal, stages, progress) if stages else list(_single_rows(case, nominal))
    found = found or list(_misplaced(few, nominal))
    wide_fit = None
    if not found and nominal.far_mm(IMPLAUSIBLE):
        progress("whether robot file and data belong together", 0.9)
        wide_fit = WideFit.of(few)
    return SetUp(nominal.implausible, nominal.mm, nominal.foreseen_mm, tuple(found), wide_fit)


def _stages(case: Case, nominal: Misfit) -> tuple[Stage, ...]:
    """What is worth supposing, simple things first; nothing of a healthy set."""
    if nominal.implausible and nominal.far_mm(SUSPICIOUS):
        return _simple, out_of_step, offset_joint, _two_kinds, two_joints, three_joints
    if nominal.far_mm(SUSPICIOUS):
        return _simple, out_of_step
    if nominal.suspicious:
        return (_orientations,)
    # a sphere of another size, seen from one side, is much the same sphere elsewhere
    return (other_spheres,) if nominal.mm > LEAST_MM and TouchRows in case.task.rows.kinds else ()


def _explained(case: Case, nominal: Misfit, stages: tuple[Stage, ...], progress: Progress) -> list[Mistake]:
    """What explains all rows at once; two or three joints only where nothing simpler does. Nothing where zeros that
    are off by little explain it as well: the identification will find them.
    """
    few = case.thinned(SAMPLE)
    for number, stage in enumerate(stages):
        progress("set-up errors", 0.9 * number / len(stages))
        source = case if stage is out_of_step else few
        judged = [_judged(supposed) for supposed in _screened(stage(source), nominal)]
        right = [
            (s, after) for s, after in judged if after.times <= EXPLAINED and nominal.times >= BETTER * after.times
        ]
        if right:
            equal = _equally_good(right)
            return [] if any(s.mastering for s, _ in equal) else [_mistake(s, nominal, after) for s, after in equal]
    return []


def _judged(supposed: Supposition) -> tuple[Supposition, Misfit]:
    small = supposed.case.thinned(SAMPLE)
    return supposed, misfit(small).foreseen(small)


def _orientations(few: Case) -> Iterator[Supposition]:
    """What leaves positions as they are."""
    yield from other_turns(few)
    yield from other_hand(few)


def _simple(few: Case) -> Iterator[Supposition]:
    for pose in (
        other_unit, other_length, other_hand, other_spheres, other_convention, metres, swapped_columns, plain_joints,
    ):  # fmt: skip
        yield from pose(few)


def _two_kinds(few: Case) -> Iterator[Supposition]:
    """Two mistakes of different kinds: a unit, a hand, a convention, and another of these, or a joint."""
    for first in _wholesale(few):
        for second in (*_wholesale(first.case), *reversed_joint(first.case)):
            if second.changes[0].key != first.changes[0].key:
                changes = (*first.changes, *second.changes)
                yield Supposition(changes, second.case, 20 + first.oddity + second.oddity)


def _wholesale(case: Case) -> Iterator[Supposition]:
    for pose in (other_unit, other_length, other_hand, other_spheres, other_convention, metres):
        yield from pose(case)


def _screened(supposed: Iterable[Supposition], nominal: Misfit) -> list[Supposition]:
    """Those that leave least at a few rows, of all that leave clearly less than there was."""
    sized = []
    for one in supposed:
        size = misfit(one.case.thinned(SCREEN), rounds=2).size
        if size < nominal.size / 2.0 and not _flat(one.case):
            sized.append((size, one))
    steps = steps_of(np.array([size for size, _ in sized]))
    order = sorted(range(len(sized)), key=lambda place: (steps[place], sized[place][1].oddity, place))
    return [sized[place][1] for place in order[:PROMISING]]


def _flat(case: Case) -> bool:
    """Whether nothing but planes was touched, and all touches lie in one: a robot that only moves in a plane touches
    any planes, and would explain everything.
    """
    if case.task.rows.kinds != {PlaneRows}:
        return False
    tips = np.concatenate([case.task.model.tip(block.postures) for block in case.task.rows.blocks])
    extents = np.linalg.svd(tips - tips.mean(axis=0), compute_uv=False)
    return bool(extents[-1] < FLAT * extents[0])


def _equally_good(right: list[tuple[Supposition, Misfit]]) -> list[tuple[Supposition, Misfit]]:
    """Those that nothing tells from the best, the least odd first; in one file, none with more changes than another."""
    best = min(after.size for _, after in right)
    equal = sorted(
        [(s, after) for s, after in right if after.size <= EQUAL * best],
        key=lambda pair: (pair[0].oddity, pair[1].size),
    )
    kept: list[tuple[Supposition, Misfit]] = []
    for supposed, after in equal:
        sources = {change.source for change in supposed.changes}
        keys = [change.key for change in supposed.changes]
        simpler = any(
            ({change.source for change in other.changes} <= sources and len(other.changes) < len(supposed.changes))
            or ([change.key for change in other.changes] == keys and other.oddity < supposed.oddity)
            for other, _ in kept
        )
        if not simpler and not any(_same(supposed, other) for other, _ in kept):
            kept.append((supposed, after))
    return kept[:NAMED]


def _same(one: Supposition, other: Supposition) -> bool:
    """Whether two suppositions say the same, but for how exactly an angle was worked out."""
    if [change.key for change in one.changes] != [change.key for change in other.changes]:
        return False
    apart = np.abs((one.case.joints.offset - other.case.joints.offset + 180.0) % 360.0 - 180.0)
    named = [re.sub(r"[\d.]+°", "", change.what) for change in one.changes]
    return named == [re.sub(r"[\d.]+°", "", change.what) for change in other.changes] and bool(np.all(apart < SAME_DEG))


def _mistake(supposed: Supposition, before: Misfit, after: Misfit) -> Mistake:
    turned = before.mm < BETTER * after.mm
    if turned:
        return Mistake(supposed.changes, before.deg, after.deg, "°")
    return Mistake(supposed.changes, before.mm, after.mm, "mm")


def _single_rows(case: Case, nominal: Misfit) -> Iterator[Mistake]:
    """Rows out of step, or exchanged, in a set-up that is right but for them."""
    if _wild(case, nominal):
        yield from _some_rows(case, put_in_step(case, nominal))


def _wild(case: Case, nominal: Misfit) -> bool:
    return wild_rows(case, nominal) >= WILD


def _some_rows(case: Case, supposed: Iterable[Supposition]) -> Iterator[Mistake]:
    """Suppositions about some rows alone, with RMS over these from where all rows together then put nominal."""
    for one in supposed:
        about = misfit(one.case.thinned(SAMPLE))
        distances = [_distances(each, about) for each in (case, one.case)]
        before, after = (mm[distances[0] != distances[1]] for mm in distances)
        yield Mistake(one.changes, rms(before), rms(np.sort(after)[: max(int(CORE * len(after)), 1)]), "mm")


def _misplaced(few: Case, nominal: Misfit) -> Iterator[Mistake]:
    """Readings in another unit where points are all that is measured: tips that hardly move lie on spheres of any size,
    but not where these roughly are. RMS of how far the points are from there.
    """
    rough = few.task.rough
    if rough is None or not np.all(np.isfinite(rough)) or few.task.rows.kinds & {PositionRows, PoseRows}:
        return
    before = rms(np.linalg.norm(nominal.state.points - rough, axis=1))
    for supposed in other_unit(few) if before > MISPLACED_MM else ():
        after = misfit(supposed.case).foreseen(supposed.case)
        nearer = rms(np.linalg.norm(after.state.points - rough, axis=1))
        if after.times <= EXPLAINED and before >= BETTER * nearer:
            yield Mistake(supposed.changes, before, nearer, "mm")


def _distances(case: Case, nominal: Misfit) -> Floats:
    return np.concatenate([mm for mm, _ in row_errors(case.task, nominal.state)])


def _figure(value: float) -> str:
    """Two significant figures at least, three for large ones, no exponent."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}" if value >= 1.0 else f"{value:.2g}"
