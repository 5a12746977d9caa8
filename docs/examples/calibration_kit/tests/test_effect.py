"""The effect with its equations, and in a fit by name."""

import numpy as np
import pytest
from calibration_kit.effect import ToolHeat

import cellctl
from cellctl.calibration import Postures

PER_K = np.array([0.004, -0.002, 0.012])
"""By which the tool moves along the flange's axes, mm/K."""


def rows(count, seed=1):
    """Readings (N, 6), deg, temperatures (N,), °C, and positions (N, 3), mm, of a robot whose tool expands."""
    draw = np.random.default_rng(seed)
    robot = cellctl.robot("kr5_r1400").file
    readings = np.array([0, -70, 90, 0, 45, 0]) + draw.uniform(-40, 40, (count, 6))
    celsius = draw.uniform(15, 35, count)
    chain, q = robot.chain(), robot.joint_map().model(readings)
    shifts = np.einsum("nij,nj->ni", chain.forward_flange(q)[:, :3, :3], np.outer(celsius - 20, PER_K))
    return readings, celsius, chain.forward(q)[:, :3, 3] + shifts + draw.normal(0, 0.01, (count, 3))


def test_the_shift_is_the_temperature_difference_along_the_axes_of_the_flange():
    chain = cellctl.robot("kr5_r1400").file.chain()
    q = np.array([[0.1, -1.2, 1.5, 0.2, 0.8, 0.3]])
    shift = ToolHeat().shifts(chain, Postures(q, delta_t=np.array([10.0])))
    assert shift == pytest.approx(10.0 * chain.forward_flange(q)[:, :3, :3])


def test_a_fit_finds_the_amounts_that_the_rows_have():
    readings, celsius, xyz = rows(80)
    columns = {f"A{axis + 1}": readings[:, axis] for axis in range(6)}
    data = cellctl.read({**columns, "temperature": celsius, **dict(zip("XYZ", xyz.T, strict=True))})
    model = cellctl.fit("kr5_r1400", data, model="geometry+tool_heat")
    assert [model.file.robot_model().amount(f"tool_heat_{axis}") for axis in "xyz"] == pytest.approx(PER_K, abs=0.001)
