"""The paper's own simulation: a KR5 with the errors of its table 2, touched on a sphere of 60 mm without any noise.

The table is printed in degrees and millimetres; its results need radians and metres. The robot is the tests' own arm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cellctl.calibration import RowBlocks, Split, Task, ToolDeflection, TouchRows, fit
from tests.helpers.own_campaigns import Campaign, nominal_of
from tests.helpers.own_model import OwnArm, kr5
from tests.studies.papers.statements import Numbers
from tests.studies.papers.world import Floats

CENTRE, RADIUS_MM = np.array([[1340.0, 240.0, 350.0]]), 30.0
BENDING = 0.002
LENGTH_M, WEIGHT_N = 0.4103, 1.535 * 9.80665
FIT, HELD_OUT = 50, 30
STATED_MM = 0.001
TABLE_2 = {
    "theta1": 1, "d1": 1, "a1": -1, "alpha1": 1,
    "theta2": 2, "a2": 1, "alpha2": -1, "beta2": 1,
    "theta3": 2, "d3": 1, "a3": -1, "alpha3": 1,
    "theta4": 1, "d4": -1, "a4": 1, "alpha4": -1,
    "theta5": 2, "d5": 1, "a5": -1, "alpha5": 1,
    "theta6": 1, "d6": -1, "a6": 1, "alpha6": -1,
}  # fmt: skip
"""In units of 0.001."""

UNITS = {"rad_m": (0.001, 1.0), "deg_mm": (np.radians(0.001), 0.001)}
"""Reading of the table → 0.001 as an angle (rad) and as a length (mm)."""


def simulated(seed: int) -> Numbers:
    """The figures of the simulation for both readings of the table, with touches drawn from `seed`."""
    return {f"{name}_{key}": value for name, units in UNITS.items() for key, value in _figures(seed, *units).items()}


def _figures(seed: int, angle: float, length: float) -> Numbers:
    nominal = kr5()
    values = [value * (length if name[0] in "ad" and name[1].isdigit() else angle) for name, value in TABLE_2.items()]
    truth = replace(nominal.moved(tuple(TABLE_2), values), bend=BENDING)
    q = _touches(np.random.default_rng([seed, 2]), nominal, truth)
    about_true = _distances(nominal.points(q), CENTRE[0])
    rows = TouchRows(q, np.zeros(len(q), int), np.full(len(q), RADIUS_MM), np.full((len(q), 1), STATED_MM))
    model = nominal_of(nominal).with_effects((ToolDeflection(LENGTH_M, WEIGHT_N),))
    task = Task(model, RowBlocks.of(rows), ("S1",), np.full((1, 3), np.nan))
    found = fit(task, Split.by_column(np.arange(len(q)) >= FIT))
    return {
        "before_mean": float(about_true.mean()),
        "before_max": float(about_true.max()),
        "fitted_centre_before_mean": found.nominal.mean,
        "fitted_centre_before_max": found.nominal.max,
        "after_mean": found.test.mean,
        "after_max": found.test.max,
    }


def _touches(rng: np.random.Generator, nominal: OwnArm, truth: OwnArm) -> Floats:
    """Angles (N, 6) at which the true robot touches the sphere at random points, the flange on the outer side."""
    campaign = Campaign(rng, nominal, truth)

    def goals(point: Floats) -> Floats:
        away = rng.normal(size=(len(point), 3))
        return np.asarray(CENTRE[0] + RADIUS_MM * away / np.linalg.norm(away, axis=1, keepdims=True))

    q = campaign.standing(np.zeros(5 * (FIT + HELD_OUT), int), goals)
    points = truth.points(q)
    outside = np.sum((truth.flange(q)[:, :3, 3] - points) * (points - CENTRE[0]), axis=1) > 0.0
    return q[outside][: FIT + HELD_OUT]


def _distances(points: Floats, centre: Floats) -> Floats:
    return np.asarray(np.abs(np.linalg.norm(points - centre, axis=1) - RADIUS_MM))
