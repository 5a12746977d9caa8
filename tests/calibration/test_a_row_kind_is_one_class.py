"""A new kind of row is one class: fit, proof, what is unobservable and the report's residuals ask it, and no edit."""

import numpy as np
import pytest

from cellctl.calibration import PositionRows, RobotModel, Split, Task, fit
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import pose_from_xyz_abc
from cellctl.report.fit.page import write_fit_page
from cellctl.setup_check import check_setup
from cellctl.setup_check.hypothesis import Setup
from docs.examples.calibration_kit.calibration_kit.row_kind import HeightRows
from tests.helpers.reports import KR5, postures, told, truth

PLACE = pose_from_xyz_abc([1500.0, -200.0, 300.0], [30.0, 2.0, -1.0])


@pytest.fixture(scope="module")
def task():
    rng = np.random.default_rng(8)
    true = truth().on(PLACE @ truth().chain.base_now, truth().chain.tool_now)
    first, second = postures(60), postures(260)[60:]
    xyz = true.tcp(first) + rng.normal(0.0, 0.02, (60, 3))
    heights = true.tcp(second)[:, 2] + rng.normal(0.0, 0.02, 200)
    blocks = [PositionRows(first, xyz, np.full((60, 3), 0.02)), HeightRows(second, heights, np.full((200, 1), 0.02))]
    return Task(RobotModel(KR5.chain()), blocks)


@pytest.fixture(scope="module")
def result(task):
    return fit(task, Split.by_column(np.arange(260) % 4 == 0))


def test_its_rows_are_fitted_and_judged(result):
    assert result.n_test == 65
    assert result.test.rms < 0.2 * result.nominal.rms
    assert result.identification.noise[-1] == pytest.approx(1.0, abs=0.3)


def test_they_tell_of_the_base(task):
    alone = Task(task.model, task.rows.blocks[1])
    unknowns = alone.unknowns(alone._unplaced_state())
    free = {
        name for name, is_free in zip(unknowns.names, alone.registration_parameters(unknowns), strict=True) if is_free
    }
    assert {"base_z", "base_b", "tool_x"} <= free


def test_what_they_cannot_see_is_named_in_words(task):
    alone = Task(task.model, task.rows.blocks[1])
    seen = fit(alone, Split(np.arange(200), ())).observability
    words = " ".join(seen.unseen)
    assert "base translation along" in words or "base rotation about" in words


def test_an_outlier_among_them_is_left_out(task):
    positions, heights = task.rows.blocks
    wrong = heights.height.copy()
    wrong[7] += 3.0
    rows = RowBlocks((positions, heights.changed(height=wrong)))
    found = fit(Task(task.model, rows), Split(np.arange(260), ()))
    assert found.identification.outliers == (67,)


def test_the_set_up_check_judges_the_other_rows_and_says_what_it_left_out(task):
    readings = KR5.joint_map().readings(np.concatenate([block.q for block in task.rows.blocks]))
    found = check_setup(task, KR5.joint_map(), readings)
    assert found.left_out == ("200 heights",)
    assert not found.errors
    readings[:, 2] *= -1.0
    wrong = Setup(task, KR5.joint_map(), readings).with_readings(readings).task
    (error,) = check_setup(wrong, KR5.joint_map(), readings).errors
    assert "A3 reversed" in error.words()


@pytest.mark.long
def test_the_page_names_and_draws_them_and_says_why_it_proposes_none(task, tmp_path):
    page = tmp_path / "page.html"
    write_fit_page(page, told(task))
    assert "200 heights" in page.read_text()
    assert "No heights are proposed: such rows do not state where they can be measured." in page.read_text()
