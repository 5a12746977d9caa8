"""Harmonics, field and discrepancy need two standard errors, and must hold at the ends of the joint ranges."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from cellctl.calibration import (
    EffectInputs,
    Harmonics,
    JointCompliance,
    JointField,
    PositionRows,
    Postures,
    RobotModel,
    Task,
)
from cellctl.calibration.folds import FIFTH, end_folds
from cellctl.calibration.identification.ladder import _Ladder, climb
from cellctl.calibration.residuals.harmonics import SLOW
from cellctl.calibration.selection.model_error import WORSE_AT_END, Gain, worst_end
from cellctl.formats import RobotFile
from tests.studies import outside_the_joints as ur10

needs_data = pytest.mark.skipif(
    not ur10.UR10_DATA.exists(), reason=f"the UR10 measurements are not at {ur10.UR10_DATA}"
)


@pytest.mark.parametrize(
    ("group", "kept"),
    [("geometry", True), ("compliance", True), ("harmonics", False), ("field", False), ("discrepancy", False)],
)
def test_a_gain_of_one_and_a_half_standard_errors_is_enough_for_a_physical_effect_only(group, kept):
    rng = np.random.default_rng(0)
    gain = rng.normal(0.0, 1.0, 400)
    gain += 1.5 * gain.std(ddof=1) / 20.0 - gain.mean()
    before = np.full(400, 2.0)
    assert Gain.of(before, before - gain, group).significant is kept


@dataclass(frozen=True)
class Folds:
    """Held-out errors (N,) of two models, as `Folded` has them."""

    errors: tuple[np.ndarray, np.ndarray]
    folds: tuple = ()

    def with_folds(self, folds):
        return replace(self, folds=tuple(folds))

    def predicted(self, model, _):
        return SimpleNamespace(errors=np.concatenate([self.errors[model][fold] for fold in self.folds]))


def test_the_worst_end_is_that_of_one_joint_less_its_standard_error():
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.0, 1.0, (400, 3))
    before, after = np.full(400, 1.0), np.full(400, 0.5)
    assert worst_end(Folds((before, after)), q, (0, {}), (1, {})) == pytest.approx(0.5)
    upper = end_folds(q, FIFTH)[3]
    after[upper] = 1.5 + 0.2 * rng.choice([-1.0, 1.0], len(upper))
    found = worst_end(Folds((before, after)), q, (0, {}), (1, {}))
    assert found == pytest.approx(after[upper].mean() - 0.2 / np.sqrt(len(upper)), abs=5e-3)


@pytest.mark.parametrize(
    ("range_rad", "fewer_terms", "chosen"),
    [(1.0, 0.85, "fewer terms"), (1.0, 0.95, "all terms"), (1.0, 1.5, "all terms"), (0.0, 0.5, "all terms")],
    ids=["better", "hardly better", "worse", "no joint moved"],
)
def test_at_the_ends_fewer_terms_have_to_be_a_tenth_better(range_rad, fewer_terms, chosen):
    q = range_rad * np.random.default_rng(1).uniform(-1.0, 1.0, (400, 3))
    ends = np.unique(np.concatenate(end_folds(q) or [np.zeros(0, int)]))
    errors = np.full(400, 1.0), np.full(400, 2.0), np.full(400, 3.0)
    errors[1][ends], errors[2][ends] = fewer_terms, 0.99 * fewer_terms
    models = [
        SimpleNamespace(name=name, place=place, logs={})
        for place, name in enumerate(("all terms", "fewer terms", "none"))
    ]
    ladder = SimpleNamespace(rows=SimpleNamespace(q=q), folded=Folds(errors), _columns=lambda model: model.place)
    assert _Ladder.best_at_the_ends(ladder, models).name == chosen


def climbed(count, seed):
    """The terms that `count` measured postures of the UR10 support."""
    q, xyz = ur10.measured()
    rows = np.random.default_rng([seed, count]).permutation(len(q))[:count]
    chain = RobotFile.load(ur10.ROBOT).chain()
    field = JointField.of_inputs(EffectInputs(chain, Postures(q[rows])))
    candidates = (JointCompliance.of(chain), Harmonics(6), field)
    sigma = np.full((count, 3), ur10.REPEATABILITY_MM / np.sqrt(3.0))
    task = Task(RobotModel(chain), PositionRows(q[rows], xyz[rows], sigma), candidates=candidates)
    return climb(task, task.rows)


@pytest.mark.long
@needs_data
def test_harmonics_that_fail_at_an_end_of_a_joint_are_kept_without_the_bands_that_do():
    """With all bands, the 20 postures with the highest shoulder are predicted twice as far off as by geometry alone."""
    found = climbed(100, 0)
    (harmonics,) = (effect for effect in found.task.model.effects if isinstance(effect, Harmonics))
    first = next(step for step in found.steps if "harmonics" in step.model)
    assert first.kept
    assert 0.0 < first.worst_end <= WORSE_AT_END
    assert found.steps[-1].error_mm < 0.5 * found.steps[1].error_mm
    assert len({joint for joint, order in harmonics.waves if order <= SLOW} & {1, 2, 3}) < 3


@pytest.mark.long
@needs_data
def test_harmonics_of_36_postures_that_fail_at_an_end_are_left_out():
    assert "harmonics" not in {effect.group for effect in climbed(36, 0).task.model.effects}
