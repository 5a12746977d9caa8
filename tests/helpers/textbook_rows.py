"""Positions of a textbook UR10 with errors, as an instrument beside it would measure them, as a file."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tests.benchmarks.textbook import UR10, forward

SIGMA = 0.05
"""1 σ of a coordinate as the rows have it, mm."""

NOMINAL = {"base": np.array([1200.0, -300.0, 40.0, 0.3, 0.02, -0.01]), "tool": np.array([30.0, -50.0, 120.0, 0, 0, 0])}
OFF = {"base": np.array([1.0, 1.0, 2.0, 0.001, 0.001, 0.001]), "tool": np.array([1.0, 1.0, 1.0, 0, 0, 0])}
LINK_ERRORS = np.array([np.deg2rad(0.05), 0.5, np.deg2rad(0.05), 0.5])
MIDDLE, SPAN = np.deg2rad([0, -80, 0, 0, 0, 0]), np.deg2rad([170, 60, 120, 170, 170, 170])
WILD_MM = 20.0
FRESH = 300


def save_rows(path, count, *, scatter=1.0, outlying=0.0):
    """`count` positions that scatter by `scatter` σ, a share `outlying` of them centimetres off, and FRESH exact ones.

    Errors of half a millimetre and a twentieth of a degree in each link. The names in the file: see `serving.Rows`.
    """
    rng = np.random.default_rng(5)
    links = UR10 + LINK_ERRORS * rng.normal(size=UR10.shape)
    base, tool = (_frame(NOMINAL[name] + OFF[name] * rng.normal(size=6)) for name in ("base", "tool"))
    q, held_out_q = (MIDDLE + SPAN * rng.uniform(-1, 1, (rows, 6)) for rows in (count, FRESH))
    xyz, held_out_xyz = ((base @ forward(links, each) @ tool)[:, :3, 3] for each in (q, held_out_q))
    xyz = xyz + rng.normal(0, scatter * SIGMA, xyz.shape)
    xyz[: round(outlying * count)] += rng.normal(0, WILD_MM, (round(outlying * count), 3))
    rows = {"q": q, "xyz": xyz, "held_out_q": held_out_q, "held_out_xyz": held_out_xyz}
    np.savez(path, links=UR10, sigma=SIGMA, **NOMINAL, **rows)
    return path


def _frame(vector):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_euler("ZYX", vector[3:]).as_matrix(), vector[:3]
    return matrix
