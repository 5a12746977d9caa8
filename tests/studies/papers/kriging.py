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
from numpy.typing import NDArray

from cellctl.analysis import ErrorSet, mantel
from cellctl.compensation import compensate
from cellctl.error_maps import ErrorMap
from cellctl.error_maps.field import AnisotropicField
from cellctl.error_maps.inverse_distance import tuned_grid
from cellctl.error_maps.kriging import INITIAL_WEIGHTS, REGULARISATION, Kriging, ParticleFilter
from cellctl.error_maps.perceptron import tuned_perceptron
from cellctl.formats.similarity_report import robot_errors, rows_with_positions
from cellctl.metrology.axis_frames import Turn, axis_frames, reflector_on_flange, station
from cellctl.metrology.measured_points import Points
from cellctl.planning import JointRanges, Method, TaskWorkspace
from sims.conditions import REFERENCE_C, Payload
from tests.studies.papers.positions import Arm, data_of, figures, fitted, gaussian_process, identified
from tests.studies.papers.statements import Figure, Numbers, Ordering, Paper, Section, numbers_under
from tests.studies.papers.world import AS_IN_CELL, Floats, PaperWorld, Ways, ways_of

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
PERMUTATIONS = 199
TURNS = {1: 30.0, 2: 20.0, 5: 60.0, 6: 150.0}
"""Axes turned alone for the frames {B} and {T}: half of each arc, deg."""
TURN_POINTS = 9

LAMBDAS = (1e-5, 1e-4, 1e-3)
"""Regularisations tried, with all weights 1 and with searched ones."""

WITHOUT: dict[str, Mapping[str, float]] = {
    "compliance: 0": {"compliance": 0.0},
    "gear: 0": {"gear": 0.0},
    "geometry, joint_zero: 0": {"geometry": 0.0, "joint_zero": 0.0},
}
WARMER, WARMER_C = "expansion: 1, the links 3 K warmer when compensated", REFERENCE_C + 3.0
PLAY, TURNED, STIFF = "backlash: 1", "turned by ± 30°", "turned by ± 30°, compliance: 0"
TURNED_POSES = TaskWorkspace.of([(1500, 2300), (-400, 400), (-250, 250), (60, 120), (60, 120), (60, 120)])
"""Positions as in `FIXED`, orientations as varied as in the task."""

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
    def measured(cls, world: PaperWorld, readings: Floats, name: str, temperature_c: float = REFERENCE_C) -> Rows:
        """On a tour in this order, the links at this temperature."""
        ways = ways_of(readings)
        true = world.reflectors(world.flanges(readings, ways, temperature_c))[:, 0] + world.scatter(readings)
        return cls(readings, ways, true + world.noise(true, name))

    def pick(self, which: NDArray[np.int_]) -> Rows:
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


def study(seed: int) -> Numbers:
    """All numbers of one robot."""
    found = in_world(seed) | similarity(seed)
    found |= numbers_under(PLAY, in_world(seed, {"backlash": 1.0}, baselines=False))
    for switch, errors in WITHOUT.items():
        fit, _, test = measured_parts(PaperWorld.of(CELL, seed, errors))
        found |= numbers_under(switch, judged(weighted(fit), test))
    found |= numbers_under(TURNED, similarity(seed, varied=TURNED_POSES))
    return found | numbers_under(STIFF, similarity(seed, {"compliance": 0.0}, varied=TURNED_POSES))


def in_world(seed: int, switches: Mapping[str, float] = AS_IN_CELL, *, baselines: bool = True) -> Numbers:
    """Prediction and compensation, by every method; without the baselines by the paper's and ours."""
    world = PaperWorld.of(CELL, seed, switches)
    fit, weights, test = measured_parts(world)
    true = world.reflectors(world.flanges(test.readings))[:, 0]
    found = figures("nominal", test.errors) | figures("floor", test.places - true)
    predictors = {"filtered": searched(fit, weights, seed, REGULARISATION), "ours": by_fit(fit, "auto")}
    predictors |= other_predictors(seed, fit) | by_lambda(fit, weights, seed) if baselines else {}
    found |= judged(predictors, test)
    found["ours_ratio"] = found["ours_rms"] / found["floor_rms"]
    warmer = PaperWorld.of(CELL, seed, {**switches, "expansion": 1.0})
    for name in ("filtered", "ours"):
        found |= figures(f"{name}_compensated", compensated(world, predictors[name], test, name))
        again = compensated(warmer, predictors[name], test, name, WARMER_C)
        found |= numbers_under(WARMER, figures(f"{name}_compensated", again))
        found[f"{WARMER}/{name}_max"] = found[f"{name}_max"]
    return found


def measured_parts(world: PaperWorld) -> tuple[Rows, Rows, Rows]:
    """Rows of the maps, of the particle filter's test set, and held-out rows, measured on one tour in random order."""
    readings = drawn(WORKSPACE, "joint-uniform", FIT, WEIGHTS + TEST, world.seed)
    order = world.draws("tour").permutation(len(readings))
    rows, back = Rows.measured(world, readings[order], "rows"), np.argsort(order)
    return rows.pick(back[:FIT]), rows.pick(back[FIT : FIT + WEIGHTS]), rows.pick(back[-TEST:])


def judged(predictors: Mapping[str, Predictor], test: Rows) -> Numbers:
    """Figures of each on held-out rows."""
    found: Numbers = {}
    for name, predicted in predictors.items():
        found |= figures(name, predicted(test.readings) - test.errors)
    return found


def weighted(fit: Rows) -> dict[str, Predictor]:
    """The paper's kriging with joint weights that are not searched."""
    weights = {"isotropic": np.ones((3, 6)), "initial": INITIAL_WEIGHTS, "published": PUBLISHED_WEIGHTS}
    return {name: by_joints(Kriging(each).fit(fit.q, fit.errors)) for name, each in weights.items()}


def searched(fit: Rows, weights: Rows, seed: int, regularisation: float) -> Predictor:
    """The paper's kriging with joint weights from the particle filter."""
    found = ParticleFilter(INITIAL_WEIGHTS, seed=seed)
    best = found.weights(fit.q, fit.errors, weights.q, weights.errors, regularisation)
    return by_joints(Kriging(best, regularisation).fit(fit.q, fit.errors))


def by_lambda(fit: Rows, weights: Rows, seed: int) -> dict[str, Predictor]:
    """The paper's kriging with each regularisation, with searched weights and with all 1."""
    found = {f"filtered {each:g}": searched(fit, weights, seed, each) for each in LAMBDAS}
    equal = {each: Kriging(regularisation=each).fit(fit.q, fit.errors) for each in LAMBDAS}
    return found | {f"isotropic {each:g}": by_joints(one) for each, one in equal.items()}


def other_predictors(seed: int, fit: Rows) -> dict[str, Predictor]:
    """The paper's kriging with other weights, its baselines, and parts of ours."""
    found = weighted(fit) | {
        "field": by_joints(AnisotropicField().fit(fit.q, fit.errors)),
        "cartesian": by_places(Kriging().fit(fit.nominal, fit.errors)),
        "perceptron": by_places(tuned_perceptron(seed=seed).fit(fit.nominal, fit.errors)),
        "grid": by_places(tuned_grid(fit.nominal, seed=seed).fit(fit.nominal, fit.errors)),
        "process": by_joints(gaussian_process(fit.q, fit.errors, seed)),
    }
    return found | {"geometry": by_fit(fit, "geometry"), "compliance": by_fit(fit, "geometry+compliance")}


def by_joints(found: ErrorMap) -> Predictor:
    """Of a map over the joints."""
    return lambda readings: found.errors(ARM.joints.model(readings))


def by_places(found: ErrorMap) -> Predictor:
    """Of a map over the nominal positions."""
    return lambda readings: found.errors(ARM.places(readings))


def by_fit(fit: Rows, model: str) -> Predictor:
    """Of the ordinary fit with this model."""
    robot = identified(fitted(ARM, data_of(fit.readings, fit.places, 0, SIGMA_MM), model))
    return lambda readings: np.asarray(robot.pose(ARM.joints.model(readings))[:, :3, 3] - ARM.places(readings))


def compensated(
    world: PaperWorld, predicted: Predictor, test: Rows, name: str, temperature_c: float = REFERENCE_C
) -> Floats:
    """Errors (N, 3) at the held-out poses, visited again in another order with compensated joints."""
    targets = ARM.chain.forward(test.q)

    def errors(q: Floats) -> Floats:
        return predicted(ARM.joints.readings(q))

    found = compensate(ARM.chain, errors, targets, test.q, method="cyclic-search", tolerance_mm=1e-3)
    order = world.draws("tour back").permutation(len(test.readings))
    again = Rows.measured(world, ARM.joints.readings(found.compensated_q)[order], f"compensated {name}", temperature_c)
    return again.places - targets[order, :3, 3]


def similarity(
    seed: int, switches: Mapping[str, float] = AS_IN_CELL, varied: TaskWorkspace | JointRanges = VARIED
) -> Numbers:
    """Correlation of the distance of errors with that of joints, and of positions, in the paper's four sets, with p of
    a Mantel test; with base and reflector of each of `registrations`. varied: region of the sets with varied
    orientation.
    """
    found = {}
    for load, payload in (("unloaded", UNLOADED), ("loaded", None)):
        world = PaperWorld.of(CELL, seed, switches, payload)
        for kind, region in (("fixed", FIXED), ("varied", varied)):
            rows = Rows.measured(world, drawn(region, "pseudo-random", SIMILAR, 0, seed), f"{load} {kind}")
            for by, each in registrations(world, rows).items():
                spaces = {"joints": each.readings, "places": each.places}
                for space, one in mantel(each.errors, spaces, PERMUTATIONS, world.draws("Mantel")).items():
                    found[f"{by} {space}_{load}_{kind}"] = one.r
                    found[f"{by} {space}_{load}_{kind}_p"] = one.p
    return found


def registrations(world: PaperWorld, rows: Rows) -> dict[str, ErrorSet]:
    """The errors of the nominal robot, its base and reflector from the data sheet, from turned axes as in the paper's
    section 2.3, and by least squares from the same rows, as `cellctl analyse` does.
    """
    data = data_of(rows.readings, rows.places, 0, SIGMA_MM)
    return {
        "sheet": ErrorSet.of(rows.readings, rows.nominal, rows.errors),
        "turned": turned_axes(world, rows),
        "squares": robot_errors(rows_with_positions(ARM.file, data)).found,
    }


def turned_axes(world: PaperWorld, rows: Rows) -> ErrorSet:
    """The errors with the frames {B} and {T} that turns of single axes from NEAR give."""
    turns = []
    for axis, half in TURNS.items():
        readings = np.tile(NEAR, (TURN_POINTS, 1))
        readings[:, axis - 1] += np.linspace(-half, half, TURN_POINTS)
        places = Rows.measured(world, readings, f"turn {axis}").places
        turns.append(Turn(Points.of(places, SIGMA_MM), ARM.joints.model(readings)[:, axis - 1]))
    start = Rows.measured(world, NEAR[None], "turned back")
    frames = axis_frames(*turns, Points.of(start.places, SIGMA_MM))
    base = station(frames, ARM.chain, start.q[0]).matrix
    reflector, _ = reflector_on_flange(frames, ARM.chain, start.q[0])
    flanges = ARM.chain.with_base(np.eye(4)).forward_flange(rows.q)
    nominal = flanges[:, :3, :3] @ reflector + flanges[:, :3, 3]
    return ErrorSet.of(rows.readings, nominal, rows.places @ base[:3, :3].T + base[:3, 3] - nominal)


def drawn(region: TaskWorkspace | JointRanges, method: Method, fit: int, held_out: int, seed: int) -> Floats:
    """Readings (fit + held_out, n), those of the fit first."""
    return ARM.drawn(region, method, fit, held_out, seed, NEAR)


PREDICTION = (
    Figure("robot error, mean of the held-out poses, mm", "4.96", "nominal_mean", 2),
    Figure("kriging, joint weights by particle filter: mean, mm", "0.089", "filtered_mean"),
    Figure("the same: largest, mm", "0.172", "filtered_max"),
    Figure("kriging, W_init: mean, mm", "–", "initial_mean"),
    Figure("the same: largest, mm", "–", "initial_max"),
    Figure("kriging, the paper's optimum of W: mean, mm", "–", "published_mean", note="found for its robot"),
    Figure("kriging, all weights 1: mean, mm", "–", "isotropic_mean"),
    Figure("perceptron on Cartesian position: mean, mm", "0.212", "perceptron_mean", note="tuned by cross-validation"),
    Figure("the same: largest, mm", "0.359", "perceptron_max"),
    Figure("grid, inverse distance: mean, mm", "0.502", "grid_mean", note="tuned by cross-validation"),
    Figure("the same: largest, mm", "0.942", "grid_max"),
    Figure("ours, `--model auto`: mean, mm", "0.089", "ours_mean"),
    Figure("the same: largest, mm", "0.172", "ours_max"),
    Figure("the same: RMS ÷ floor of noise and play", "–", "ours_ratio", 2),
    *(
        Figure(f"kriging, {name}, λ = {each:g}: mean, mm", "–", f"{key} {each:g}_mean")
        for each in LAMBDAS
        for name, key in (("searched weights", "filtered"), ("all weights 1", "isotropic"))
    ),
    Figure("Gaussian process of scikit-learn (ARD, noise): mean, mm", "–", "process_mean"),
    Figure("the same: largest, mm", "–", "process_max"),
    Figure("our field alone, without geometry: mean, mm", "–", "field_mean"),
    Figure("geometry alone: mean, mm", "–", "geometry_mean"),
    Figure("geometry + compliance: mean, mm", "–", "compliance_mean"),
    Figure("floor: mean, mm", "–", "floor_mean"),
    Figure("floor: largest, mm", "–", "floor_max"),
)
ORDERED = (
    Ordering("kriging < perceptron on position, mean", "0.089 < 0.212", "filtered_mean", "perceptron_mean"),
    Ordering("perceptron < grid, mean", "0.212 < 0.502", "perceptron_mean", "grid_mean"),
    Ordering("kriging over the joints < over positions, mean", "–", "isotropic_mean", "cartesian_mean"),
    Ordering("weights by particle filter < all weights 1, mean", "–", "filtered_mean", "isotropic_mean"),
    Ordering("weights by particle filter < W_init, mean", "–", "filtered_mean", "initial_mean"),
    Ordering("W_init < all weights 1, mean", "implied", "initial_mean", "isotropic_mean", worlds=tuple(WITHOUT)),
    Ordering("ours < the paper's kriging, mean", "–", "ours_mean", "filtered_mean"),
    Ordering("ours < scikit-learn's Gaussian process, mean", "–", "ours_mean", "process_mean"),
    Ordering("the process < the paper's kriging, mean", "–", "process_mean", "filtered_mean"),
    Ordering("ours < the paper's kriging, largest", "–", "ours_max", "filtered_max"),
)
COMPENSATION = (
    Figure("robot error before, largest, mm", "4.96", "nominal_max", 2, "the paper does not say mean or largest"),
    Figure("after cyclic search with kriging, mean, mm", "–", "filtered_compensated_mean"),
    Figure("after cyclic search with kriging, largest, mm", "0.28", "filtered_compensated_max"),
    Figure("after cyclic search with ours, mean, mm", "–", "ours_compensated_mean"),
    Figure("after cyclic search with ours, largest, mm", "0.28", "ours_compensated_max"),
    Figure(f"with kriging, `{WARMER}`, largest, mm", "0.28", f"{WARMER}/filtered_compensated_max"),
    Figure("with kriging, `backlash: 1`, largest, mm", "0.28", f"{PLAY}/filtered_compensated_max"),
    Figure("with ours, `backlash: 1`, largest, mm", "0.28", f"{PLAY}/ours_compensated_max"),
    Ordering("after < before, largest", "0.28 < 4.96", "filtered_compensated_max", "nominal_max", 2),
    Ordering(
        "predicted < after compensation, largest",
        "0.172 < 0.28",
        "filtered_max",
        "filtered_compensated_max",
        worlds=(PLAY, WARMER),
        note="play is in both numbers: each pose is reached by another way than its neighbours",
    ),
)
PUBLISHED = {
    "unloaded_fixed": ("0.469", "0.440"),
    "loaded_fixed": ("0.424", "0.381"),
    "unloaded_varied": ("0.472", "0.214"),
    "loaded_varied": ("0.403", "0.226"),
}


REGISTERED = {
    "turned": "base and reflector from turned axes, the paper's section 2.3",
    "squares": "base and reflector by least squares, as `cellctl analyse` does",
    "sheet": "base and reflector as in the data sheet",
}
SPACES = {"joints": "De–Dq", "places": "De–Dp"}
LOADS = ("unloaded", "loaded")


def _correlations(by: str) -> tuple[Figure | Ordering, ...]:
    """Figures and orderings with one of the registrations."""
    figures_of = [
        Figure(f"{name}, {kind.replace('_', ', orientation ')}", value, f"{by} {space}_{kind}", 2)
        for kind, values in PUBLISHED.items()
        for (space, name), value in zip(SPACES.items(), values, strict=True)
    ]
    tests = [
        Figure(f"p of a Mantel test, De–Dq, {load}, varied", "–", f"{by} joints_{load}_varied_p") for load in LOADS
    ]
    wider = [
        Figure(f"{name}, loaded, {TURNED}", "–", f"{TURNED}/{by} {space}_loaded_varied", 2)
        for space, name in SPACES.items()
    ]
    falls = [
        Ordering(
            f"De–Dp falls when the orientation varies, {load}",
            f"{PUBLISHED[f'{load}_varied'][1]} < {PUBLISHED[f'{load}_fixed'][1]}",
            f"{by} places_{load}_varied",
            f"{by} places_{load}_fixed",
            2,
        )
        for load in LOADS
    ]
    less = [
        Ordering(
            f"De–Dp < De–Dq when the orientation varies, {load}",
            f"{PUBLISHED[f'{load}_varied'][1]} < {PUBLISHED[f'{load}_varied'][0]}",
            f"{by} places_{load}_varied",
            f"{by} joints_{load}_varied",
            2,
            (TURNED, STIFF),
        )
        for load in LOADS
    ]
    return (*figures_of, *tests, *wider, *falls, *less)


PAPER = Paper(
    tag="krg",
    title="Meng et al. 2024: kriging of position errors in configuration space",
    command="python -m tests.studies papers --papers krg",
    study=study,
    sections=(
        Section("Prediction: 160 points, 80 held out", (*PREDICTION, *ORDERED)),
        Section("Compensation of the 80 held-out poses", COMPENSATION),
        *(Section(f"Similarity of errors: {text}", _correlations(by)) for by, text in REGISTERED.items()),
    ),
)
