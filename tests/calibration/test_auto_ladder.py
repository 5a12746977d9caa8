"""`auto` on the simulated World, which is written apart from cellctl: it keeps what is there, and nothing else."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cellctl.calibration import (
    Backlash,
    FitResult,
    Harmonics,
    JointCompliance,
    PositionRows,
    Postures,
    Split,
    State,
    Task,
    ThermalExpansion,
    Tolerances,
    Unknowns,
    fit,
    identify,
)
from cellctl.formats import RobotFile, nominal_model
from sims.cell import read_cell
from sims.conditions import Conditions
from sims.world import World
from tests.helpers.own_campaigns import place

PROCEDURES = Path(__file__).parents[2] / "procedures"
ROBOT = RobotFile.load(PROCEDURES / "robots" / "kr5_r1400.yaml")
CELL = read_cell(PROCEDURES / "cells" / "sphere_cell.yaml")
LOW, HIGH = np.array([-90, -110, 40, -170, -100, -170.0]), np.array([90, -30, 120, 170, 100, 170.0])
SIGMA = 0.02
GEOMETRY = {"geometry": 1.0, "joint_zero": 1.0, "tool": 1.0}
FIT, HELD_OUT = 150, 100


@dataclass(frozen=True)
class Measured:
    """A robot of the World, its tool's true places (N, 3) in the tracker's frame, and what the tracker saw."""

    rows: PositionRows
    true: np.ndarray
    effects: tuple

    def fitted(self, count, *effects, auto=False):
        task = Task(nominal_model(ROBOT).with_effects(effects), self.rows, candidates=self.effects if auto else None)
        return fit(task, Split.by_column(np.arange(len(self.true)) >= count))

    def true_error(self, result: FitResult):
        """RMS of the distance from the truth at the held-out rows, mm."""
        held_out = self.rows.pick(np.arange(len(self.true)) >= result.n_fit)
        tips = result.identification.identified.state.model.tcp(held_out.at)
        return float(np.sqrt(np.mean(np.sum((tips - self.true[result.n_fit :]) ** 2, axis=1))))


@cache
def measured(seed, count, kinds=(), *, perfect=False, payload=False, ripple_deg=0.0):
    """A robot with errors of `kinds` beside its geometry's; ripple_deg: 17 times per turn of joint 2."""
    rng = np.random.default_rng([seed, 21])
    readings, ways = rng.uniform(LOW, HIGH, (count, 6)), rng.choice([-1, 1], (count, 6))
    celsius, kilograms = rng.uniform(15.0, 35.0, count), rng.choice([0.0, 5.0], count)
    world = World(replace(CELL, simulate=replace(CELL.simulate, errors=errors_of(kinds, perfect))), seed)
    asked = readings + np.outer(ripple_deg * np.sin(17.0 * np.radians(readings[:, 1])), np.eye(6)[1])
    conditions = [
        Conditions(tuple(map(int, way)), warm if "expansion" in kinds else 20.0, load if payload else 0.0)
        for way, warm, load in zip(ways, celsius, kilograms, strict=True)
    ]
    points = np.array([world.true_tcp(list(a), under) for a, under in zip(asked, conditions, strict=True)])
    tracker = place(rng)
    true = points @ tracker[:3, :3].T + tracker[:3, 3]
    signs = np.array([joint.sign for joint in ROBOT.joints], float)
    at = Postures(
        ROBOT.joint_map().model(readings),
        ways * signs if "backlash" in kinds else None,
        celsius - 20.0 if "expansion" in kinds else None,
        kilograms if payload else None,
    )
    rows = PositionRows(at, true + rng.normal(0.0, SIGMA, true.shape), np.full(true.shape, SIGMA))
    return Measured(rows, true, candidates(kinds, payload))


def errors_of(kinds, perfect):
    switched = dict.fromkeys(CELL.simulate.errors, 0.0)
    return {**switched, **({} if perfect else GEOMETRY), **dict.fromkeys(kinds, 1.0)}


def candidates(kinds, payload):
    """The effects that auto tries where the data set has these columns."""
    chain = ROBOT.chain()
    tried = [JointCompliance.of(chain, load_known=payload), Harmonics(6)]
    tried += [Backlash(6)] if "backlash" in kinds else []
    return (*tried, *([ThermalExpansion.of(chain)] if "expansion" in kinds else []))


KEPT = {"compliance": "compliance", "gear": "harmonics", "backlash": "backlash", "expansion": "growth"}


@pytest.mark.parametrize(
    ("seed", "kind"),
    [pytest.param(seed, kind, marks=pytest.mark.long if seed else ()) for seed, kind in enumerate(KEPT)],
)
def test_an_effect_that_is_there_is_kept_and_the_truth_comes_nearer(seed, kind):
    """Noise of 0.02 mm in 450 numbers foretells the tool to 0.02 · √(60 unknowns / 150 rows): 0.013 mm."""
    of = measured(seed, FIT + HELD_OUT, (kind,))
    auto, plain = of.fitted(FIT, auto=True), of.fitted(FIT)
    assert KEPT[kind] in auto.model.split("+")
    assert of.true_error(auto) < 0.5 * of.true_error(plain)
    assert of.true_error(auto) < 0.02
    assert auto.verdict == "better"


@pytest.mark.long
def test_all_effects_at_once_are_told_apart():
    of = measured(10, 340, tuple(KEPT))
    auto, plain = of.fitted(220, auto=True), of.fitted(220)
    assert auto.model == "geometry+compliance+harmonics+backlash+growth"
    assert of.true_error(auto) < 0.1 * of.true_error(plain)
    assert auto.coverage_95 > 0.89  # of 120 rows: 3 σ below 0.95


@pytest.mark.long
def test_a_payload_that_changes_is_told_from_the_links_own_weight():
    of = measured(4, FIT + HELD_OUT, ("compliance",), payload=True)
    known, unknown = (of.fitted(FIT, JointCompliance.of(ROBOT.chain(), load_known=known)) for known in (True, False))
    assert of.true_error(known) < 0.02 < 2.0 * of.true_error(known) < of.true_error(unknown)


@pytest.mark.long
def test_an_effect_that_is_not_there_is_hardly_ever_added_and_never_does_harm():
    robots = [measured(seed, 120) for seed in range(100, 110)]
    pairs = [(of.fitted(60, auto=True), of.fitted(60)) for of in robots]
    assert sum(auto.model != "geometry" for auto, _ in pairs) <= 1
    for of, (auto, plain) in zip(robots, pairs, strict=True):
        assert of.true_error(auto) <= 1.05 * of.true_error(plain)


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_that_is_as_its_file_says_is_not_made_worse_and_nothing_is_claimed(seed):
    of = measured(200 + seed, 120, perfect=True)
    auto = of.fitted(60, auto=True)
    assert auto.model == "registration"
    assert auto.verdict == "no better"
    assert of.true_error(auto) <= of.true_error(of.fitted(60))


@pytest.mark.long
def test_a_wave_that_nobody_named_is_in_the_turns_of_its_joint():
    """17 waves per turn of joint 2, which moves over 80°: there waves of neighbouring orders make the same shape."""
    of = measured(5, 350, ripple_deg=0.01)
    auto, plain = of.fitted(250, auto=True), of.fitted(250)
    assert auto.model == "geometry+harmonics"
    assert of.true_error(auto) < 0.3 * of.true_error(plain)
    model, readings = auto.identification.identified.state.model, np.linspace(LOW, HIGH, 200)
    (effect,), q = model.effects, ROBOT.joint_map().model(readings)
    amounts = [model.amount(parameter.name) for parameter in effect.parameters]
    turned = effect.turns(model.chain, Postures(q)).total(np.array(amounts), 6)[:, 1]
    true = ROBOT.joints[1].sign * np.radians(0.01) * np.sin(17.0 * np.radians(readings[:, 1]))
    like_geometry = np.stack([np.ones(200), np.sin(q[:, 1]), np.cos(q[:, 1])], axis=1)  # zeros, links
    away = turned - true - like_geometry @ np.linalg.lstsq(like_geometry, turned - true, rcond=None)[0]
    assert np.sqrt(np.mean(away**2)) < 0.2 * np.sqrt(np.mean(true**2))


@pytest.mark.parametrize("seed", range(2))
def test_rows_that_only_a_later_effect_explains_come_back(seed):
    """Three rows measured in the heat: wild to geometry, and just where growth puts them that milder rows show."""
    rng, hot = np.random.default_rng([seed, 31]), (5, 30, 55)
    growth = ThermalExpansion.of(ROBOT.chain())
    nominal = nominal_model(ROBOT).with_effects((growth,))
    errors = rng.normal(0.0, Unknowns.of(State.alone(nominal), (), Tolerances()).sigma)
    errors[-len(growth.parameters) :] = 3.6e-5
    delta_t = rng.uniform(-4.0, 4.0, 120)
    delta_t[list(hot)] = 25.0
    at = Postures(ROBOT.joint_map().model(rng.uniform(LOW, HIGH, (120, 6))), delta_t=delta_t)
    xyz = nominal.with_deviations(errors).tcp(at) + rng.normal(0.0, SIGMA, (120, 3))
    task = Task(nominal_model(ROBOT), PositionRows(at, xyz, np.full((120, 3), SIGMA)))
    assert identify(task, np.arange(80)).outliers == hot
    auto = fit(replace(task, candidates=(growth,)), Split.by_column(np.arange(120) >= 80))
    assert auto.model == "geometry+growth"
    assert auto.identification.outliers == ()
