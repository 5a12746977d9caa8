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
from cellctl.calibration.rows import PlaneRows, PoseRows, PositionRows, TouchRows
from cellctl.kinematics import Floats, JointMap
from cellctl.setup_check.hypothesis import Change, Hypothesis
from cellctl.setup_check.joint_columns import other_unit, swapped_columns
from cellctl.setup_check.link_table import metres, other_convention
from cellctl.setup_check.measured_values import other_hand, other_length, other_spheres
from cellctl.setup_check.misfit import (
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
from cellctl.setup_check.mixed_units import mixed_units
from cellctl.setup_check.orientations import other_orientations
from cellctl.setup_check.row_order import count_outliers, out_of_step, put_in_step
from cellctl.setup_check.setup import Setup
from cellctl.setup_check.signs_and_zeros import offset_joint, plain_joints, reversed_joint, three_joints, two_joints
from cellctl.setup_check.wide_fit import WideFit

Stage: TypeAlias = Callable[[Setup], Iterator[Hypothesis]]
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
class SetupError:
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
class SetupCheck:
    """What was found. implausible: whether nominal is too far from the rows for any robot of its kind; rms_mm,
    foreseen_mm: how far, and what tolerances foresee. mistakes: explanations, best first; any one of them explains all.
    wide_fit: where nothing explains it, what a fit within wide tolerances leaves.
    """

    implausible: bool
    rms_mm: float
    predicted_mm: float
    errors: tuple[SetupError, ...] = ()
    wide_fit: WideFit | None = None


NOTHING = SetupCheck(False, 0.0, 0.0)
"""Nothing was found, or there was nothing to find it by."""


def check_setup(task: Task, joints: JointMap, readings: Floats, progress: Progress = silent) -> SetupCheck:
    """Mistakes of set-up in `task`, whose rows were read at controller readings (M, n), deg, through `joints`.

    Where several explanations leave as little, all are named: the rows cannot tell which it is. Rows on which nominal
    cannot be registered numerically accuse nobody.
    """
    if len(task.rows) < ROWS_AT_LEAST or task.rows.size < 2 * task.registering:
        return NOTHING
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            return _searched(Setup(task, joints, np.asarray(readings, float)), progress)
    except np.linalg.LinAlgError:
        return NOTHING


def _searched(setup: Setup, progress: Progress) -> SetupCheck:
    sample = setup.thinned(SAMPLE)
    nominal = misfit(sample).with_prediction(sample)
    stages = _stages(setup, nominal)
    found = list(_some_rows(setup, mixed_units(setup))) if nominal.suspicious or _has_outliers(setup, nominal) else []
    if not found:
        found = _explained(setup, nominal, stages, progress) if stages else list(_single_rows(setup, nominal))
    found = found or list(_misplaced(sample, nominal))
    wide_fit = None
    if not found and nominal.far_mm(IMPLAUSIBLE):
        progress("whether robot file and data belong together", 0.9)
        wide_fit = WideFit.of(sample)
    return SetupCheck(nominal.implausible, nominal.mm, nominal.predicted_mm, tuple(found), wide_fit)


def _stages(setup: Setup, nominal: Misfit) -> tuple[Stage, ...]:
    """What is worth supposing, simple things first; nothing of a healthy set."""
    if nominal.implausible and nominal.far_mm(SUSPICIOUS):
        return _simple, out_of_step, offset_joint, _two_kinds, two_joints, three_joints
    if nominal.far_mm(SUSPICIOUS):
        return _simple, out_of_step
    if nominal.suspicious:
        return (_orientations,)
    # a sphere of another size, seen from one side, is much the same sphere elsewhere
    return (other_spheres,) if nominal.mm > LEAST_MM and TouchRows in setup.task.rows.kinds else ()


def _explained(setup: Setup, nominal: Misfit, stages: tuple[Stage, ...], progress: Progress) -> list[SetupError]:
    """What explains all rows at once; two or three joints only where nothing simpler does. Nothing where zeros that
    are off by little explain it as well: the identification will find them.
    """
    sample = setup.thinned(SAMPLE)
    for number, stage in enumerate(stages):
        progress("set-up errors", 0.9 * number / len(stages))
        source = setup if stage is out_of_step else sample
        judged = [_judged(hypothesis) for hypothesis in _screened(stage(source), nominal)]
        right = [
            (s, after) for s, after in judged if after.ratio <= EXPLAINED and nominal.ratio >= BETTER * after.ratio
        ]
        if right:
            equal = _equally_good(right)
            return [] if any(s.mastering for s, _ in equal) else [_error(s, nominal, after) for s, after in equal]
    return []


def _judged(hypothesis: Hypothesis) -> tuple[Hypothesis, Misfit]:
    small = hypothesis.setup.thinned(SAMPLE)
    return hypothesis, misfit(small).with_prediction(small)


def _orientations(sample: Setup) -> Iterator[Hypothesis]:
    """What leaves positions as they are."""
    yield from other_orientations(sample)
    yield from other_hand(sample)


def _simple(sample: Setup) -> Iterator[Hypothesis]:
    for propose in (
        other_unit, other_length, other_hand, other_spheres, other_convention, metres, swapped_columns, plain_joints,
    ):  # fmt: skip
        yield from propose(sample)


def _two_kinds(sample: Setup) -> Iterator[Hypothesis]:
    """Two mistakes of different kinds: a unit, a hand, a convention, and another of these, or a joint."""
    for first in _wholesale(sample):
        for second in (*_wholesale(first.setup), *reversed_joint(first.setup)):
            if second.changes[0].key != first.changes[0].key:
                changes = (*first.changes, *second.changes)
                yield Hypothesis(changes, second.setup, 20 + first.complexity + second.complexity)


def _wholesale(setup: Setup) -> Iterator[Hypothesis]:
    for propose in (other_unit, other_length, other_hand, other_spheres, other_convention, metres):
        yield from propose(setup)


def _screened(hypothesis: Iterable[Hypothesis], nominal: Misfit) -> list[Hypothesis]:
    """Those that leave least at a few rows, of all that leave clearly less than there was."""
    sized = []
    for one in hypothesis:
        size = misfit(one.setup.thinned(SCREEN), rounds=2).size
        if size < nominal.size / 2.0 and not _flat(one.setup):
            sized.append((size, one))
    steps = steps_of(np.array([size for size, _ in sized]))
    order = sorted(range(len(sized)), key=lambda place: (steps[place], sized[place][1].complexity, place))
    return [sized[place][1] for place in order[:PROMISING]]


def _flat(setup: Setup) -> bool:
    """Whether nothing but planes was touched, and all touches lie in one: a robot that only moves in a plane touches
    any planes, and would explain everything.
    """
    if setup.task.rows.kinds != {PlaneRows}:
        return False
    tcps = np.concatenate([setup.task.model.tip(block.postures) for block in setup.task.rows.blocks])
    extents = np.linalg.svd(tcps - tcps.mean(axis=0), compute_uv=False)
    return bool(extents[-1] < FLAT * extents[0])


def _equally_good(right: list[tuple[Hypothesis, Misfit]]) -> list[tuple[Hypothesis, Misfit]]:
    """Those that nothing tells from the best, the least odd first; in one file, none with more changes than another."""
    best = min(after.size for _, after in right)
    equal = sorted(
        [(s, after) for s, after in right if after.size <= EQUAL * best],
        key=lambda pair: (pair[0].complexity, pair[1].size),
    )
    kept: list[tuple[Hypothesis, Misfit]] = []
    for hypothesis, after in equal:
        sources = {change.source for change in hypothesis.changes}
        keys = [change.key for change in hypothesis.changes]
        simpler = any(
            ({change.source for change in other.changes} <= sources and len(other.changes) < len(hypothesis.changes))
            or ([change.key for change in other.changes] == keys and other.complexity < hypothesis.complexity)
            for other, _ in kept
        )
        if not simpler and not any(_same(hypothesis, other) for other, _ in kept):
            kept.append((hypothesis, after))
    return kept[:NAMED]


def _same(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two suppositions say the same, but for how exactly an angle was worked out."""
    if [change.key for change in one.changes] != [change.key for change in other.changes]:
        return False
    apart = np.abs((one.setup.joints.offset - other.setup.joints.offset + 180.0) % 360.0 - 180.0)
    named = [re.sub(r"[\d.]+°", "", change.what) for change in one.changes]
    return named == [re.sub(r"[\d.]+°", "", change.what) for change in other.changes] and bool(np.all(apart < SAME_DEG))


def _error(hypothesis: Hypothesis, before: Misfit, after: Misfit) -> SetupError:
    turned = before.mm < BETTER * after.mm
    if turned:
        return SetupError(hypothesis.changes, before.deg, after.deg, "°")
    return SetupError(hypothesis.changes, before.mm, after.mm, "mm")


def _single_rows(setup: Setup, nominal: Misfit) -> Iterator[SetupError]:
    """Rows out of step, or exchanged, in a set-up that is right but for them."""
    if _has_outliers(setup, nominal):
        yield from _some_rows(setup, put_in_step(setup, nominal))


def _has_outliers(setup: Setup, nominal: Misfit) -> bool:
    return count_outliers(setup, nominal) >= WILD


def _some_rows(setup: Setup, hypothesis: Iterable[Hypothesis]) -> Iterator[SetupError]:
    """Suppositions about some rows alone, with RMS over these from where all rows together then put nominal."""
    for one in hypothesis:
        about = misfit(one.setup.thinned(SAMPLE))
        distances = [_distances(each, about) for each in (setup, one.setup)]
        before, after = (mm[distances[0] != distances[1]] for mm in distances)
        yield SetupError(one.changes, rms(before), rms(np.sort(after)[: max(int(CORE * len(after)), 1)]), "mm")


def _misplaced(sample: Setup, nominal: Misfit) -> Iterator[SetupError]:
    """Readings in another unit where points are all that is measured: tips that hardly move lie on spheres of any size,
    but not where these roughly are. RMS of how far the points are from there.
    """
    rough = sample.task.rough
    if rough is None or not np.all(np.isfinite(rough)) or sample.task.rows.kinds & {PositionRows, PoseRows}:
        return
    before = rms(np.linalg.norm(nominal.state.points - rough, axis=1))
    for hypothesis in other_unit(sample) if before > MISPLACED_MM else ():
        after = misfit(hypothesis.setup).with_prediction(hypothesis.setup)
        nearer = rms(np.linalg.norm(after.state.points - rough, axis=1))
        if after.ratio <= EXPLAINED and before >= BETTER * nearer:
            yield SetupError(hypothesis.changes, before, nearer, "mm")


def _distances(setup: Setup, nominal: Misfit) -> Floats:
    return np.concatenate([mm for mm, _ in row_errors(setup.task, nominal.state)])


def _figure(value: float) -> str:
    """Two significant figures at least, three for large ones, no exponent."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}" if value >= 1.0 else f"{value:.2g}"
