"""KRG: kriging of position errors in configuration space (Meng et al. 2024, doi 10.3390/app142411682).

A KR300 class robot with 120 kg, one reflector, 160 poses of its task workspace and 80 held-out ones; 40 more for the
joint weights. All methods get the same measured errors, actual − nominal, in the robot's base frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from positions import Arm, Numbers, data_of, figures, fitted, identified
from scipy.spatial.distance import pdist
from world import AS_IN_CELL, Floats, PaperWorld, Ways, ways_of

from cellctl.compensation import cyclic_search
from cellctl.error_maps.inverse_distance import tuned_grid
from cellctl.error_maps.joint_weights import ParticleFilter
from cellctl.error_maps.kriging import INITIAL_WEIGHTS, Kriging
from cellctl.error_maps.perceptron import tuned_perceptron
from cellctl.planning import JointRanges, Method, Reach, TargetOptions, TaskWorkspace, plan_targets
from sims.conditions import Payload

CELL = Path(__file__).parents[3] / "procedures" / "papers" / "cells" / "heavy_robot_cell.yaml"
ARM = Arm.of(CELL)

FIT, WEIGHTS, TEST = 160, 40, 80
"""Rows of the maps and fits, of the test set of the particle filter, and held-out rows that are reported."""

WORKSPACE = TaskWorkspace.of([(1600, 2400), (-400, 800), (-400, 400), (85, 95), (75, 105), (60, 120)])
NEAR = np.array([0.0, -60.0, 90.0, 0.0, 60.0, 0.0])
SIMILAR = 50
FIXED = TaskWorkspace.of([(1400, 2400), (-500, 500), (-250, 250), (90, 90), (90, 90), (90, 90)])
VARIED = JointRanges(np.array([-5.0, -95, 85, -5, 85, -5]), np.array([5.0, -85, 95, 5, 95, 5]))
"""Sets of 50 poses: 1 × 1 × 0.5 m with constant orientation, and joints in a box of ± 5°."""

PUBLISHED_WEIGHTS = np.array(
    [
        [0.985, 0.619, 1.157, 1.068, 1.216, 0.686],
        [0.954, 1.183, 0.700, 0.667, 0.688, 1.015],
        [0.813, 0.349, 1.542, 0.476, 1.218, 0.353],
    ]
)
"""The paper's optimum; for its own robot."""

SIGMA_MM = 0.03 / np.sqrt(3.0)
UNLOADED = Payload(0.0)

Predictor = Callable[[Floats], Floats]
"""Predicted errors (N, 3), mm, at readings (N, n), deg."""


@final
@dataclass(frozen=True, eq=False)
class Rows:
    """Measured rows: readings (N, n), deg; ways (N, n): of the last motion; places (N, 3), mm."""

    readings: Floats
    ways: Ways
    places: Floats

    @classmethod
    def measured(cls, world: PaperWorld, readings: Floats, name: str) -> Rows:
        """On a tour in this order."""
        ways = ways_of(readings)
        return cls(readings, ways, world.measured_points(readings, name, ways))

    def part(self, which: slice) -> Rows:
        """Some of them."""
        return Rows(self.readings[which], self.ways[which], self.places[which])

    @property
    def q(self) -> Floats:
        """Model angles (N, n), rad."""
        return np.asarray(ARM.joints.model(self.readings))

    @property
    def nominal(self) -> Floats:
        """Where the nominal robot would be (N, 3)."""
        return ARM.places(self.readings)

    @property
    def errors(self) -> Floats:
        """Actual − nominal (N, 3)."""
        return self.places - self.nominal


def numbers(seed: int) -> Numbers:
    """All numbers of one robot."""
    return in_world(seed) | similarity(seed)


def in_world(seed: int, switches: Mapping[str, float] = AS_IN_CELL) -> Numbers:
    """Prediction and compensation, by every method."""
    world = PaperWorld.of(CELL, seed, switches)
    readings = drawn(WORKSPACE, "joint-uniform", FIT, WEIGHTS + TEST, seed)
    order = world.draws("tour").permutation(len(readings))
    rows = Rows.measured(world, readings[order], "rows")
    back = np.argsort(order)
    rows = Rows(rows.readings[back], rows.ways[back], rows.places[back])
    fit, weights, test = (rows.part(one) for one in (slice(0, FIT), slice(FIT, FIT + WEIGHTS), slice(-TEST, None)))
    true = world.reflectors(world.flanges(test.readings))[:, 0]
    found = figures("nominal", test.errors) | figures("floor", test.places - true)
    predictors = paper_predictors(seed, fit, weights)
    result = fitted(ARM, data_of(rows_of(fit, test), places_of(fit, test), TEST, SIGMA_MM))
    robot = identified(result)
    predictors["ours"] = lambda angles: robot.pose(ARM.joints.model(angles))[:, :3, 3] - ARM.places(angles)
    geometry = fitted(ARM, data_of(fit.readings, fit.places, 0, SIGMA_MM), "geometry")
    plain = identified(geometry)
    predictors["geometry"] = lambda angles: plain.pose(ARM.joints.model(angles))[:, :3, 3] - ARM.places(angles)
    for name, predicted in predictors.items():
        found |= figures(name, predicted(test.readings) - test.errors)
    found["ours_ratio"] = found["ours_rms"] / found["floor_rms"]
    for name in ("filtered", "ours"):
        found |= figures(f"{name}_compensated", compensated(world, predictors[name], test, name))
    return found


def paper_predictors(seed: int, fit: Rows, weights: Rows) -> dict[str, Predictor]:
    """The paper's kriging with four sets of weights, and its baselines."""
    filtered = ParticleFilter(INITIAL_WEIGHTS, seed=seed).weights(fit.q, fit.errors, weights.q, weights.errors)
    of_weights = {
        "isotropic": np.ones((3, 6)),
        "initial": INITIAL_WEIGHTS,
        "published": PUBLISHED_WEIGHTS,
        "filtered": filtered,
    }
    on_joints = {name: Kriging(each).fit(fit.q, fit.errors) for name, each in of_weights.items()}
    on_places = {
        "cartesian": Kriging().fit(fit.nominal, fit.errors),
        "perceptron": tuned_perceptron(seed=seed).fit(fit.nominal, fit.errors),
        "grid": tuned_grid(fit.nominal, seed=seed).fit(fit.nominal, fit.errors),
    }
    found: dict[str, Predictor] = {}
    for name, by_joints in on_joints.items():
        found[name] = lambda angles, known=by_joints: known.errors(ARM.joints.model(angles))
    for name, by_place in on_places.items():
        found[name] = lambda angles, known=by_place: known.errors(ARM.places(angles))
    return found


def compensated(world: PaperWorld, predicted: Predictor, test: Rows, name: str) -> Floats:
    """Errors (N, 3) at the held-out poses, visited again in another order with compensated joints."""
    targets = ARM.chain.forward(test.q)
    found = cyclic_search(ARM.chain, lambda q: predicted(ARM.joints.readings(q)), targets, test.q)
    order = world.draws("tour back").permutation(len(test.readings))
    again = Rows.measured(world, ARM.joints.readings(found.q)[order], f"compensated {name}")
    return again.places - targets[order, :3, 3]


def similarity(seed: int) -> Numbers:
    """Correlation of the distance of errors with that of joints, and of positions, in the paper's four sets."""
    found = {}
    for load, payload in (("unloaded", UNLOADED), ("loaded", None)):
        world = PaperWorld.of(CELL, seed, payload=payload)
        for kind, region in (("fixed", FIXED), ("varied", VARIED)):
            rows = Rows.measured(world, drawn(region, "pseudo-random", SIMILAR, 0, seed), f"{load} {kind}")
            apart = pdist(rows.errors)
            found[f"joints_{load}_{kind}"] = correlation(apart, pdist(rows.readings))
            found[f"places_{load}_{kind}"] = correlation(apart, pdist(rows.nominal))
    return found


def correlation(one: Floats, other: Floats) -> float:
    """Pearson's."""
    return float(np.corrcoef(one, other)[0, 1])


def drawn(region: TaskWorkspace | JointRanges, method: Method, fit: int, held_out: int, seed: int) -> Floats:
    """Readings (fit + held_out, n), those of the fit first."""
    limits = ARM.file.limits()
    reach = Reach(tuple(limits[:, 0].tolist()), tuple(limits[:, 1].tolist()), margin=5.0)
    options = TargetOptions(near=NEAR)
    found = plan_targets(ARM.chain, ARM.joints, reach, region, method, fit, held_out, seed, options)
    return np.concatenate([found.readings[~found.held_out], found.readings[found.held_out]])


def rows_of(*parts: Rows) -> Floats:
    """Readings, one part after another."""
    return np.concatenate([part.readings for part in parts])


def places_of(*parts: Rows) -> Floats:
    """Places, one part after another."""
    return np.concatenate([part.places for part in parts])
