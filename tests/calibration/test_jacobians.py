"""Every derivative the estimator uses, against central differences, away from nominal and with a bending tool."""

import numpy as np
import pytest

from cellctl.calibration import (
    PoseRows,
    PositionRows,
    RobotModel,
    SpacingRows,
    State,
    ToolDeflection,
    TouchRows,
)
from cellctl.kinematics import Link, SerialChain, pose_from_xyz_abc
from tests.helpers.arms import KR5_LINKS

RNG = np.random.default_rng(2)
Q = RNG.uniform(-1.5, 1.5, (5, 6))
CENTRES = np.array([[900.0, -300.0, 200.0], [950.0, 320.0, 260.0], [1150.0, 10.0, 380.0]])


@pytest.fixture(params=["stiff", "bending"])
def state(request):
    base, tool = pose_from_xyz_abc([100, 50, -20], [30, 10, 170]), pose_from_xyz_abc([60, 50, 410], [39, 4, 0])
    chain = SerialChain.from_links("mdh-hayati", KR5_LINKS, base, tool)
    # a bend ten times that of a real torch, so that its derivatives by the geometry are not lost in rounding
    model = RobotModel(chain, (ToolDeflection(0.41, 15.0),) if request.param == "bending" else ())
    sizes = np.where(model.parameter_turns, 0.01, 2.0)
    if request.param == "bending":
        sizes[-1] = 0.004
    return State.alone(model.with_deviations(sizes * RNG.standard_normal(sizes.size)), CENTRES)


def moved(state, index, step):
    deviations, centres = state.model.deviations.copy(), state.points.copy()
    if index < deviations.size:
        deviations[index] += step
    else:
        centres.flat[index - deviations.size] += step
    return State.alone(state.model.with_deviations(deviations), centres)


def rows_of_every_kind():
    yield PositionRows(Q, RNG.uniform(-900, 900, (5, 3)), np.ones((5, 3)))
    turns = pose_from_xyz_abc(RNG.uniform(-900, 900, (5, 3)), RNG.uniform(-60, 60, (5, 3)))
    yield PoseRows(Q, turns, np.ones((5, 6)))
    yield TouchRows(Q, np.array([0, 1, 2, 0, 1]), np.full(5, 31.3), np.ones((5, 1)))
    yield SpacingRows(np.array([[0, 1], [2, 1]]), np.array([600.0, 400.0]), np.ones((2, 1)))


@pytest.mark.parametrize("rows", list(rows_of_every_kind()), ids=lambda rows: type(rows).__name__)
def test_residuals_change_with_every_unknown_as_the_jacobian_says(rows, state):
    columns = rows.jacobian(state)
    count = len(state.model.parameters) + state.points.size
    assert columns.shape == (*rows.residual(state).shape, count)
    turns = np.append(state.model.parameter_turns, np.zeros(9, bool))
    for index in range(count):
        step = 1e-5 if turns[index] or index == len(state.model.parameters) - 1 else 1e-2
        ahead, behind = rows.residual(moved(state, index, step)), rows.residual(moved(state, index, -step))
        numeric = (ahead - behind) / (2 * step)
        scale = max(1.0, np.abs(numeric).max())
        np.testing.assert_allclose(columns[..., index], numeric, atol=1e-6 * scale, err_msg=str(index))


def test_a_horizontal_torch_of_the_published_size_bends_by_an_eighth_of_a_millimetre():
    bend = ToolDeflection(0.4103, 1.535 * 9.80665)
    assert 0.00036 * bend.mm_per_unit == pytest.approx(0.125, abs=0.001)


def test_a_hanging_tool_does_not_bend():
    chain = SerialChain.from_links("mdh-hayati", [Link(0, 0, 0, np.pi), Link(0, 0, 0, 0)])
    tool = RobotModel(chain, (ToolDeflection(0.4, 15.0),), np.array([0.001]))
    np.testing.assert_allclose(tool.tcp(np.zeros(2)), chain.forward(np.zeros(2))[:3, 3], atol=1e-12)
