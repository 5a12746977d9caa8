"""ANN: point selection, joint flexibility from motor currents and a network.

Mathematical Problems in Engineering 2020, article 9035425.

A flexible 6-axis arm whose tracker positions and motor currents are recorded; constant orientation throughout, a
U-shaped path. In the cell's World the joints wind up under the whole torque of the motors, friction included, as the
paper assumes; `friction_torsion: 0` is the other World, in which they turn by the weight alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from cellctl.calibration import Postures
from cellctl.error_maps.motor_flexibility import FlexibilityNetwork, MotorFlexibility
from cellctl.kinematics import SerialChain, pose, rotation_from_abc
from cellctl.planning import Method, TaskWorkspace
from cellctl.planning._target_sets import along, near_path
from sims.conditions import Payload
from tests.studies.papers.positions import Arm, data_of, figures, fitted, gaussian_process, identified, least_squares
from tests.studies.papers.statements import Figure, Numbers, Ordering, Paper, Section, numbers_under
from tests.studies.papers.world import AS_IN_CELL, Floats, PaperWorld, Ways, ways_of

CELL = Path(__file__).parents[3] / "procedures" / "papers" / "cells" / "flexible_arm_cell.yaml"
ARM = Arm.of(CELL)
SIGNS = np.array([joint.sign for joint in ARM.file.joints], float)
"""Of the readings' sense of rotation, in which currents count too."""

ALL, FIT, TEST, TRAINING, ON_PATH, EACH = 2000, 80, 50, 500, 50, 10
TURNED = (155.0, 0.0, 180.0)
BOX = [(700.0, 1250.0), (-450.0, 450.0), (300.0, 850.0)]
WORKSPACE = TaskWorkspace.of([*BOX, *((angle, angle) for angle in TURNED)])
VARIED = TaskWorkspace.of([*BOX, (115, 195), (-40, 40), (140, 220)])
NEAR = np.array([0.0, -90.0, 90.0, 0.0, 45.0, -30.0])
PATH = np.array([[800.0, -350, 400], [800, -350, 750], [1100, 350, 750], [1100, 350, 400]])
"""U-shaped: up, across, down; mm."""

EXPECTED_RAD_PER_A = 1e-2
"""Prior 1 σ of a flexibility for the paper's method: it has none, so one that hardly acts."""

WEIGHT, UNLOADED = "friction_torsion: 0", "friction_torsion: 0, the 80 points measured without the load"
RIGID, ROUGH = "rigid joints, orientation varied", "rigid joints, orientation varied, geometry: 5"
STIFF = {"compliance": 0.0, "friction_torsion": 0.0, "gear": 0.0}
"""Switches, by their names on the page."""

SIGMA_MM, NOISE_A, SAMPLES = 0.02, 0.004, 10
"""1 σ of a position on one axis; of a current, share of the rated one; samples of a current."""

Indices = NDArray[np.int_]


@final
@dataclass(frozen=True, eq=False)
class Rows:
    """Measured rows: readings (N, n), deg; places (N, 3), mm; currents (N, n), A, as the controller counts them; ways
    (N, n): of the last motion.
    """

    readings: Floats
    places: Floats
    currents: Floats
    ways: Ways

    @classmethod
    def measured(cls, world: PaperWorld, readings: Floats, name: str) -> Rows:
        """On a tour in this order."""
        ways = ways_of(np.vstack([NEAR, readings]))[1:]
        noise = world.draws(f"currents {name}").normal(size=readings.shape) * world.world.motors.rated_a
        currents = world.currents(readings, ways) + NOISE_A / np.sqrt(SAMPLES) * noise
        return cls(readings, world.measured_points(readings, name, ways), currents, ways)

    def pick(self, which: object) -> Rows:
        """Some of them."""
        parts = (np.asarray(part)[which] for part in (self.readings, self.places, self.currents, self.ways))
        return Rows(*parts)

    def joined(self, other: Rows) -> Rows:
        """These, then others."""
        pairs = zip(self._parts, other._parts, strict=True)
        return Rows(*(np.concatenate(pair) for pair in pairs))

    @property
    def q(self) -> Floats:
        """Model angles (N, n), rad."""
        return np.asarray(ARM.joints.model(self.readings))

    @property
    def model_currents(self) -> Floats:
        """Currents (N, n), A, in the model's sense of rotation."""
        return self.currents * SIGNS

    @property
    def _parts(self) -> tuple[Floats, Floats, Floats, Ways]:
        return self.readings, self.places, self.currents, self.ways

    def left(self, chain: SerialChain) -> Floats:
        """Measured minus predicted (N, 3)."""
        return np.asarray(self.places - chain.forward(self.q)[:, :3, 3])


@final
@dataclass(frozen=True, eq=False)
class Bench:
    """One robot: the rows on the path and elsewhere, which every method is judged on. seed: of the draws."""

    world: PaperWorld
    unloaded: PaperWorld
    seed: int
    path: Rows
    test: Rows

    @classmethod
    def of(cls, seed: int, switches: Mapping[str, float], *, unloaded: bool) -> Bench:
        """unloaded: the 80 points are measured without the load."""
        world = PaperWorld.of(CELL, seed, switches)
        bare = PaperWorld.of(CELL, seed, switches, Payload(0.0)) if unloaded else world
        poses = pose(np.tile(rotation_from_abc(np.array(TURNED)), (ON_PATH, 1, 1)), along(PATH, ON_PATH))
        path = Rows.measured(world, np.round(ARM.readings(poses, NEAR), 4), "path")
        test = Rows.measured(bare, drawn(WORKSPACE, "pseudo-random", TEST, 1000 + seed), "test")
        return cls(world, bare, seed, path, test)

    def floor(self) -> Floats:
        """Errors (N, 3) on the path of the robot's true mean at the motions made."""
        true = self.world.reflectors(self.world.flanges(self.path.readings, self.path.ways))[:, 0]
        return self.path.places - true


def study(seed: int) -> Numbers:
    """All numbers of one robot."""
    found = in_world(seed)
    found |= numbers_under(WEIGHT, in_world(seed, {"friction_torsion": 0.0}))
    found |= numbers_under(UNLOADED, in_world(seed, {"friction_torsion": 0.0}, unloaded=True))
    found |= numbers_under(RIGID, models(seed, VARIED, STIFF))
    return found | numbers_under(ROUGH, models(seed, VARIED, {**STIFF, "geometry": 5.0}))


def in_world(seed: int, switches: Mapping[str, float] = AS_IN_CELL, *, unloaded: bool = False) -> Numbers:
    """The paper's method with its ablations, and ours."""
    bench = Bench.of(seed, switches, unloaded=unloaded)
    found = figures("nominal", bench.test.places - ARM.places(bench.test.readings))
    found |= figures("path_nominal", bench.path.places - ARM.places(bench.path.readings))
    found |= figures("floor", bench.floor())
    quasi = drawn(WORKSPACE, "quasi-random", ALL, seed)
    found |= by_paper(bench, quasi, "paper") | models(seed, WORKSPACE, switches)
    found |= by_paper(bench, drawn(WORKSPACE, "pseudo-random", ALL, seed), "pseudo")
    return found if unloaded else found | ours(bench, quasi, alone=not switches)


def by_paper(bench: Bench, readings: Floats, name: str) -> Numbers:
    """POE by 80 of the points, F by what it leaves at all, the network near the path; and arbitrary training points."""
    first = Rows.measured(bench.unloaded, readings[:FIT], f"{name} fit")
    everything = Rows.measured(bench.world, readings, f"{name} all")
    chain = least_squares(ARM.table(convention="poe"), first.q, first.places)
    flexibility = MotorFlexibility.identified(
        chain,
        everything.q,
        everything.model_currents,
        everything.left(chain),
        sigma_mm=SIGMA_MM,
        expected=EXPECTED_RAD_PER_A,
    )
    path, left = bench.path, bench.path.left(chain)
    training = {"network": near_training(readings), "arbitrary": anywhere(bench, TRAINING)}
    if name == "paper":
        nearest = nearest_training(readings)
        training |= {"literal": nearest, "as few": anywhere(bench, len(nearest))}
    networks = {
        kind: FlexibilityNetwork.trained(flexibility, rows.q, rows.model_currents, seed=bench.seed)
        for kind, rows in ((kind, everything.pick(which)) for kind, which in training.items())
    }
    found = figures(f"{name}_poe", bench.test.left(chain)) | figures(f"{name}_path_poe", left)
    found |= figures(f"{name}_direct", left - flexibility.errors(path.q, path.model_currents))
    for kind, network in networks.items():
        found |= figures(f"{name}_{kind}", left - network.errors(path.q))
        found[f"{name}_{kind}_points"] = float(len(training[kind]))
    return found


def models(seed: int, region: TaskWorkspace, switches: Mapping[str, float] = AS_IN_CELL) -> Numbers:
    """DH without β, MDH with β and POE, identified by 80 quasi-random points of a region, judged by 50 others."""
    world = PaperWorld.of(CELL, seed, switches)
    fit = Rows.measured(world, drawn(region, "quasi-random", FIT, seed), "models fit")
    test = Rows.measured(world, drawn(region, "pseudo-random", TEST, 1000 + seed), "models test")
    found: Numbers = {}
    for kind in ("dh", "mdh", "poe"):
        found |= figures(f"model_{kind}", test.left(least_squares(ARM.table(convention=kind), fit.q, fit.places)))
    return found


def ours(bench: Bench, readings: Floats, *, alone: bool) -> Numbers:
    """The ordinary fit to the same 80 points and 500 near the path: with the direction of each joint's last motion
    (`auto`), with motor currents (`geometry+motor`), and, if `alone`, with neither, beside a peer that has neither.
    """
    first = Rows.measured(bench.world, readings[:FIT], "paper fit")
    rows = first.joined(Rows.measured(bench.world, readings[near_training(readings)], "near"))
    path, bare = bench.path, data_of(rows.readings, rows.places, 0, SIGMA_MM)
    directed = data_of(rows.readings, rows.places, 0, SIGMA_MM, ways=rows.ways)
    with_currents = data_of(rows.readings, rows.places, 0, SIGMA_MM, currents=rows.currents)
    asked = {
        "ours": (directed, "auto", Postures(path.q, approach=path.ways * SIGNS)),
        "motor": (with_currents, "geometry+motor", Postures(path.q, currents=path.model_currents)),
    }
    if alone:
        asked["neither"] = (bare, "auto", Postures(path.q))
    found: Numbers = {}
    floor = figures("floor", bench.floor())["floor_rms"]
    for name, (data, model, at) in asked.items():
        robot = identified(fitted(ARM, data, model))
        found |= figures(name, robot.pose(at)[:, :3, 3] - path.places)
        found[f"{name}_ratio"] = found[f"{name}_rms"] / floor
    if alone:
        process = gaussian_process(rows.q, rows.places - ARM.places(rows.readings), bench.seed)
        found |= figures("process", ARM.places(path.readings) + process.errors(path.q) - path.places)
    return found


def near_training(readings: Floats) -> Indices:
    """Which 500 of the readings are nearest to the path (`near_path`)."""
    return near_path(ARM.places(readings), along(PATH, ON_PATH), TRAINING)


def nearest_training(readings: Floats) -> Indices:
    """Which readings are among the 10 nearest to one of 50 points of the path: the paper's rule to the letter."""
    distances = cdist(along(PATH, ON_PATH), ARM.places(readings))
    return np.unique(np.argsort(distances, axis=1, kind="stable")[:, :EACH])


def anywhere(bench: Bench, count: int) -> Indices:
    """As many of all readings at random."""
    return bench.world.draws("arbitrary").choice(ALL, count, replace=False)


def drawn(region: TaskWorkspace, method: Method, count: int, seed: int) -> Floats:
    """Readings (N, n), deg."""
    return ARM.drawn(region, method, count, 0, seed, NEAR)


WORLDS = (WEIGHT, UNLOADED)
NETWORK = "paper_network_mean"

PAPER = Paper(
    tag="ann",
    title="Mathematical Problems in Engineering 2020, 9035425: point selection, motor currents and a network",
    command="python -m tests.studies papers --papers ann",
    study=study,
    sections=(
        Section(
            "Geometry by 80 quasi-random points, judged at 50 others",
            (
                Figure("before, mm", "5.12", "nominal_mean", 2),
                Figure("POE, mm", "1.81", "paper_poe_mean", 2),
                Figure("DH without β, mm", "2.27", "model_dh_mean", 2),
                Figure("MDH with β, mm", "–", "model_mdh_mean", 2),
                Figure(f"POE, `{WEIGHT}`, mm", "1.81", f"{WEIGHT}/paper_poe_mean", 2),
                Ordering("POE < before", "1.81 < 5.12", "paper_poe_mean", "nominal_mean", 2),
                Ordering("POE < DH without β", "1.81 < 2.27", "model_poe_mean", "model_dh_mean", 4, (RIGID, ROUGH)),
                Ordering("POE < MDH with β", "–", "model_poe_mean", "model_mdh_mean", 4, note="they are equal"),
            ),
        ),
        Section(
            "On the U-shaped path, after training near it",
            (
                Figure("POE alone, mm", "1.81", "paper_path_poe_mean", 2, "the paper's figure is not of the path"),
                Figure("POE + network, mm", "1.23", "paper_network_mean", 2),
                Figure("POE + F·I at the measured currents, mm", "–", "paper_direct_mean", 2),
                Figure("network, arbitrary training points, mm", "1.57", "paper_arbitrary_mean", 2),
                Figure(
                    "training points by the paper's rule: the 10 nearest to each of 50",
                    "500",
                    "paper_literal_points",
                    0,
                ),
                Figure("network, trained by these, mm", "1.23", "paper_literal_mean", 3),
                Figure("network, trained by as many arbitrary ones, mm", "1.57", "paper_as few_mean", 3),
                Figure("network, pseudo-random points, mm", "1.53", "pseudo_network_mean", 2),
                *(
                    Figure(f"{what}, `{world}`, mm", paper, f"{world}/{key}", 3)
                    for world in WORLDS
                    for what, paper, key in (
                        ("POE alone", "1.81", "paper_path_poe_mean"),
                        ("POE + network", "1.23", "paper_network_mean"),
                        ("POE + F·I", "–", "paper_direct_mean"),
                    )
                ),
                Ordering("network < POE alone", "1.23 < 1.81", "paper_network_mean", "paper_path_poe_mean", 3, WORLDS),
                Ordering("F·I at the currents < POE alone", "–", "paper_direct_mean", "paper_path_poe_mean", 3, WORLDS),
                Ordering("F·I at the currents < network", "–", "paper_direct_mean", "paper_network_mean", 3, WORLDS),
                Ordering(
                    "near the path < arbitrary, the paper's rule",
                    "1.23 < 1.57",
                    "paper_literal_mean",
                    "paper_as few_mean",
                    4,
                    WORLDS,
                ),
                Ordering(
                    "near the path < arbitrary, 500 points",
                    "1.23 < 1.57",
                    "paper_network_mean",
                    "paper_arbitrary_mean",
                    4,
                    WORLDS,
                ),
                Ordering(
                    "Sobol < pseudo-random", "1.23 < 1.53", "paper_network_mean", "pseudo_network_mean", 4, WORLDS
                ),
            ),
        ),
        Section(
            "Ours on the path, from the same 580 points",
            (
                Figure("`auto` with the direction of each last motion: mean, mm", "1.23", "ours_mean"),
                Figure("the same: largest, mm", "–", "ours_max"),
                Figure("the same: RMS ÷ floor", "–", "ours_ratio", 2),
                Figure("`geometry+motor` at the measured currents: mean, mm", "1.23", "motor_mean"),
                Figure("the same: RMS ÷ floor", "–", "motor_ratio", 2, "the floor has no noise of currents"),
                Figure("`auto` with neither: mean, mm", "1.23", "neither_mean"),
                Figure(f"`auto` with directions, `{WEIGHT}`: mean, mm", "1.23", f"{WEIGHT}/ours_mean"),
                Figure("the same: RMS ÷ floor", "–", f"{WEIGHT}/ours_ratio", 2),
                Figure(f"`geometry+motor`, `{WEIGHT}`: mean, mm", "–", f"{WEIGHT}/motor_mean"),
                Figure("floor: mean, mm", "–", "floor_mean"),
                Figure("Gaussian process of scikit-learn, without either: mean, mm", "–", "process_mean"),
                Ordering("ours, with neither < the Gaussian process", "–", "neither_mean", "process_mean"),
                Ordering("ours < POE + network", "–", "ours_mean", "paper_network_mean"),
                Ordering("ours < POE + F·I", "–", "ours_mean", "paper_direct_mean"),
                Ordering("currents in the fit < without", "–", "motor_mean", "neither_mean"),
            ),
        ),
    ),
)
