"""The row kind in a fit with positions."""

import numpy as np
import pytest

import cellctl


def data(heights, seed=1):
    """60 positions and so many heights, mm, of a robot whose third link is 0.5 mm longer."""
    draw = np.random.default_rng(seed)
    robot = cellctl.robot("kr5_r1400")
    q = np.array([0, -70, 90, 0, 45, 0]) + draw.uniform(-40, 40, (60 + heights, 6))
    xyz = robot.forward(q)[:, :3, 3] + draw.normal(0, 0.01, (60 + heights, 3))
    columns = {f"A{axis + 1}": q[:, axis] for axis in range(6)}
    empty = np.full(60, np.nan)
    columns |= {name: np.append(xyz[:60, axis], np.full(heights, np.nan)) for axis, name in enumerate("XYZ")}
    return cellctl.read({**columns, "height": np.append(empty, xyz[60:, 2])})


def test_positions_and_heights_are_fitted_together():
    model = cellctl.fit("kr5_r1400", data(40), model="geometry")
    assert model.report["measure"] == "position+height"
    assert model.report["fit"]["rms"] == pytest.approx(0.01, abs=0.005)
