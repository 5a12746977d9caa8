"""Touches on spheres by an independent robot: what the identification gains, and what it says that it cannot see."""

import numpy as np
import pytest

from cellctl.calibration import Split, fit, identify

LATER = np.arange(80) >= 50


@pytest.fixture(scope="module")
def result(touches, touch_task):
    return fit(touch_task(touches), Split.by_column(LATER))


def volumetric_rms(identification, touches, kr5):
    """3-D RMS over the workspace after the best rigid fit, mm: accuracy where nothing was touched."""
    readings = np.random.default_rng(3).uniform([-40, -110, 40, -90, 10, -90], [40, -40, 120, 90, 90, 90], (300, 6))
    found = identification.identified.state.model.tcp(kr5.joint_map().model(readings))
    truth = np.array([touches.robot.tcp(row) for row in readings])
    found, truth = found - found.mean(0), truth - truth.mean(0)
    u, _, vt = np.linalg.svd(truth.T @ found)
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return np.sqrt(np.mean(np.sum((found @ turn.T - truth) ** 2, axis=1)))


def test_held_out_touches_fall_from_half_a_millimetre_to_the_scatter(result):
    assert result.nominal.mean >= 0.5
    assert result.test.mean <= 0.05
    assert result.test.max <= 0.2
    assert result.verdict == "better"


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
def test_other_robots_of_the_class_come_out_as_well(seed, draw, touch_task):
    found = fit(touch_task(draw(seed, 80)), Split.by_column(LATER))
    assert found.nominal.mean >= 0.5
    assert found.test.mean <= 0.05


def test_the_foretold_error_is_the_one_found(result):
    assert result.predicted_test_rms == pytest.approx(result.test.rms, rel=0.5)
    assert result.coverage_95 >= 0.85


def test_certified_spacings_make_the_robot_right_where_it_touched_nothing(result, touches, touch_task, kr5):
    without = fit(touch_task(touches, spacings=False), Split.by_column(LATER))
    assert volumetric_rms(result.identification, touches, kr5) <= 0.15
    assert volumetric_rms(result.identification, touches, kr5) < 0.7 * volumetric_rms(
        without.identification, touches, kr5
    )


def test_what_touches_can_never_see_is_named(result):
    words = result.observability.unseen
    assert len(words) == result.n_parameters - result.observability.rank
    assert "θ1 with centres of S1, S2, S3" in words
    assert "d1 with centres of S1, S2, S3" in words
    assert any(word.startswith("θ6 with tool") for word in words)


def test_one_sphere_leaves_three_of_the_papers_28_parameters_unseen(draw, touch_task):
    task = touch_task(draw(2, 60, spheres=([1150.0, 0.0, 400.0],)))
    found = identify(_with_tool_held(task))
    from cellctl.calibration import observability

    seen = observability(found.identified)
    assert found.identified.unknowns.free.sum() == 28
    assert seen.rank == 25


def _with_tool_held(task):
    from dataclasses import replace

    return replace(task, groups=frozenset({"geometry", "deflection"}))


def test_the_tools_bend_is_found(result):
    model = result.identification.identified.state.model
    (bend,) = model.effects
    assert model.amount("tool_deflection") * bend.mm_per_unit == pytest.approx(0.125, abs=0.1)


def test_a_bend_is_never_negative(draw, touch_task):
    touches = draw(11, 50)
    rigid = draw(11, 50, robot=_rigid(touches.robot))
    assert identify(touch_task(rigid)).identified.state.model.amount("tool_deflection") >= 0.0


def _rigid(robot):
    from dataclasses import replace

    return replace(robot, bend=-0.2)


def test_held_out_rows_have_no_say_in_the_model(touches, touch_task, result):
    task = touch_task(touches)
    task.rows.q[50:] += 0.3
    again = fit(task, Split.by_column(LATER)).identification.identified
    np.testing.assert_array_equal(again.deviations, result.identification.identified.deviations)


def test_the_same_rows_give_the_same_bytes(touches, touch_task, result):
    again = fit(touch_task(touches), Split.by_column(LATER))
    assert again.summary() == result.summary()
    first, second = again.identification.identified, result.identification.identified
    assert first.covariance.tobytes() == second.covariance.tobytes()


def test_a_wild_touch_is_left_out_and_named(touches, touch_task, result):
    task = touch_task(touches)
    task.rows.only.reach[7] += 3.0
    found = fit(task, Split.by_column(LATER))
    assert found.identification.outliers == (7,)
    assert found.test.mean <= 0.05


def test_without_rough_places_the_spheres_are_found(touches, touch_task, result):
    from dataclasses import replace

    found = identify(replace(touch_task(touches), rough=None), ~LATER)
    np.testing.assert_allclose(found.identified.state.points, result.identification.identified.state.points, atol=1e-3)


def test_folds_judge_every_row_by_a_model_that_never_saw_it(touches, touch_task):
    split = Split.folds(80, 4, seed=0)
    assert sorted(np.concatenate([test for _, test in split.judged]).tolist()) == list(range(80))
    assert all(not set(fit_rows) & set(test) for fit_rows, test in split.judged)
    found = fit(touch_task(touches), split)
    assert found.n_fit == found.n_test == 80
    assert found.test.mean <= 0.05


@pytest.mark.parametrize("seed", range(5))
def test_ten_touches_prove_nothing_however_the_others_fall(touches, touch_task, seed):
    """Nine unknowns of the centres from ten touches: nominal looks bad on all others, and anything is better."""
    drawn = np.random.default_rng(seed).permutation(80)
    fit_rows, test = np.sort(drawn[:10]), np.sort(drawn[10:15])
    found = fit(touch_task(touches), Split(fit_rows, ((fit_rows, test),)))
    assert found.verdict != "better"
    assert found.verdict == "worse" or "10 rows in the fit are too few to judge it by others" in found.verdict_reason


def test_a_sphere_that_the_fit_hardly_touched_judges_nothing(touches, touch_task):
    fit_rows = np.array([*np.flatnonzero(touches.sphere[:50] != 2), 2, 5])
    found = fit(touch_task(touches), Split(fit_rows, ((fit_rows, np.arange(50, 80)),)))
    assert found.verdict_reason == "sphere S3 has 2 touches in the fit, 4 at least"


def test_sigma_over_the_region_tells_what_the_spheres_residual_does_not(result, touches, touch_task, kr5):
    without = fit(touch_task(touches, spacings=False), Split.by_column(LATER))
    assert without.test.mean == pytest.approx(result.test.mean, abs=0.01)
    assert without.predicted_volumetric_rms > 1.3 * result.predicted_volumetric_rms
    for found in (result, without):
        real = volumetric_rms(found.identification, touches, kr5)
        assert 0.3 * found.predicted_volumetric_rms < real < 3.0 * found.predicted_volumetric_rms


def test_single_parameters_that_no_touch_sees_stand_in_one_phrase(touches, touch_task):
    from dataclasses import replace

    task = touch_task(touches)
    one_pose_and_wrist = replace(task.rows.only.pick(np.zeros(20, int)), at=np.zeros((20, 6)))
    found = fit(replace(task, rows=one_pose_and_wrist), Split.by_column(np.arange(20) >= 15))
    alone = [words for words in found.observability.unseen if words.endswith("alone")]
    assert len(alone) == 1
    assert alone[0].endswith(": each alone")
