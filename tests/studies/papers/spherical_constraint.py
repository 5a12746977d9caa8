"""Wang et al. 2024 (doi 10.3390/app14219824): a KR5 R1400 touches one sphere; its statements on simulated robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from cellctl.calibration import FitResult, Task, Tolerances
from cellctl.kinematics import Link, LinkTable, SerialChain
from cellctl.kinematics._conversion import to_poe
from tests.helpers.simulated_data import workspace_of
from tests.studies.constraint_kinds import ANCHORS, ONE, PLANES, Rows, bars, measured, planes, sockets, spheres, wires
from tests.studies.papers.statements import Figure, Numbers, Ordering, Paper, Section, numbers_under, under
from tests.studies.papers.table_errors import simulated
from tests.studies.papers.touching import TouchCell, Touched, touched, volumetric
from tests.studies.papers.world import Floats, PaperWorld

CELL = Path(__file__).parents[3] / "procedures" / "cells" / "single_sphere_cell.yaml"
FIT, HELD_OUT, POSTURES = 50, 30, 256
SAG_MM = 1000.0 * 0.4103**3 / 3.0 * 1.535 * 9.80665
"""How far the tip of the level torch sinks, mm, for c_t = 1."""

FLEXIBLE, SCATTER, LARGE = "compliance, gear, backlash: 1", "repeatability: 20", "geometry: 3"
SWITCHES: dict[str, Mapping[str, float]] = {
    FLEXIBLE: {"compliance": 1.0, "gear": 1.0, "backlash": 1.0},
    SCATTER: {"repeatability": 20.0},
}
LOOSE = Tolerances(link_mm=50.0, angle_deg=5.0, joint_zero_deg=5.0, tool_mm=50.0)
ALL = tuple(SWITCHES)
NO_NOISE = "without noise nothing is left"
UNOBSERVABLE = "base heading and height; the last link with the tool"
BY_HAND, POOR_LENGTH = "point aligned by hand, 0.1 mm", "length to 0.1 mm"


def study(seed: int) -> Numbers:
    """All numbers of one seed."""
    cell = TouchCell.load(CELL)
    found = _identified(cell, seed, {})
    for switch, errors in SWITCHES.items():
        found |= numbers_under(switch, _identified(cell, seed, errors))
    found |= _models(cell, seed, {}) | numbers_under(LARGE, _models(cell, seed, {"geometry": 3.0}))
    return found | _constraints(cell, seed) | simulated(seed)


def _identified(cell: TouchCell, seed: int, switches: Mapping[str, float]) -> Numbers:
    """The published fit: geometry, tool deflection and centre, judged on held-out touches and over the workspace."""
    world = PaperWorld.of(CELL, seed, switches)
    touches = touched(cell, world, FIT, HELD_OUT)
    result = touches.fitted(touches.task())
    asked = workspace_of(cell.robot, POSTURES)
    true = world.points(asked)
    bending = result.identification.identified.state.model.amount("tool_deflection") or 0.0
    return {
        "before_mean": result.nominal.mean,
        "before_max": result.nominal.max,
        "after_mean": result.test.mean,
        "after_max": result.test.max,
        "sag_mm": bending * SAG_MM,
        "free": float(result.n_parameters),
        "unobservable": float(len(result.observability.unseen)),
        "volumetric_before": volumetric(result.identification.nominal.state.model, cell.robot, asked, true),
        "volumetric_after": _volumetric(result, cell, asked, true),
    }


def _models(cell: TouchCell, seed: int, switches: Mapping[str, float]) -> Numbers:
    """The same touches with each description of the robot, and without a prior."""
    world = PaperWorld.of(CELL, seed, switches)
    touches = touched(cell, world, FIT, HELD_OUT)
    asked = workspace_of(cell.robot, POSTURES)
    true, task = world.points(asked), touches.task()
    tried = {
        "mdh": task,
        "dh": _described(task, without_beta(cell.robot.chain())),
        "poe": _described(task, to_poe(cell.robot.chain())),
        "no_prior": replace(task, tolerances=LOOSE),
    }
    return {
        f"{name}_{key}": value
        for name, one in tried.items()
        for key, value in _judged(touches, one, cell, asked, true).items()
    }


def _judged(touches: Touched, task: Task, cell: TouchCell, asked: Floats, true: Floats) -> Numbers:
    result = touches.fitted(task)
    return {"after_mean": result.test.mean, "volumetric_after": _volumetric(result, cell, asked, true)}


def _described(task: Task, chain: SerialChain) -> Task:
    return replace(task, model=replace(task.model, chain=chain))


def without_beta(chain: SerialChain) -> SerialChain:
    """The chain's table as plain Denavit–Hartenberg rows: d in place of Hayati's β, which must be 0."""
    assert isinstance(chain.table, LinkTable)
    assert not any(link.beta for link in chain.table.links)
    links = [Link(link.theta, link.d, link.a, link.alpha) for link in chain.table.links]
    return SerialChain.from_links(chain.table.convention, links, chain.base, chain.tool)


def _volumetric(result: FitResult, cell: TouchCell, asked: Floats, true: Floats) -> float:
    return volumetric(result.identification.identified.state.model, cell.robot, asked, true)


def _constraints(cell: TouchCell, seed: int) -> Numbers:
    """Volumetric error by kind of constraint, 50 touches each, one place of each (0.03 mm; the tests' own arm)."""
    asked = cell.robot.joint_map().model(workspace_of(cell.robot, POSTURES))

    def after(rows: Rows, places: Floats) -> float:
        return measured(rows, places, False, FIT, seed, asked)["after"]

    sphere = after(spheres, ONE)
    return {
        "sphere": sphere,
        "plane": after(planes, PLANES[:1]),
        "point": after(sockets, ONE),
        "rod": after(bars, ANCHORS[:1]),
        "wire": after(wires, ANCHORS[:1]),
        under(BY_HAND, "sphere"): sphere,
        under(BY_HAND, "point"): after(partial(sockets, sigma=0.1), ONE),
        under(POOR_LENGTH, "sphere"): sphere,
        under(POOR_LENGTH, "rod"): after(partial(bars, sigma=0.1), ANCHORS[:1]),
        under(POOR_LENGTH, "wire"): after(partial(wires, sigma=0.1), ANCHORS[:1]),
    }


HELD_OUT_TOUCHES = Section(
    "Held-out touches of the sphere",
    (
        Figure("mean before, mm", "1.923", "before_mean"),
        Figure("mean after, mm", "0.383", "after_mean", note="our robots have no error that the model lacks"),
        Figure("largest before, mm", "4.715", "before_max"),
        Figure("largest after, mm", "1.153", "after_max"),
        Figure(f"mean after, `{FLEXIBLE}`, mm", "0.383", under(FLEXIBLE, "after_mean")),
        Figure(f"mean after, `{SCATTER}` (0.6 mm), mm", "0.383", under(SCATTER, "after_mean")),
        Figure(f"largest after, `{SCATTER}`, mm", "1.153", under(SCATTER, "after_max")),
        Figure("sag of the level torch, identified, mm", "0.125", "sag_mm", note="true: 0.125"),
        Figure(f"the same, `{FLEXIBLE}`, mm", "", under(FLEXIBLE, "sag_mm"), note="it takes up sag of the joints"),
        Ordering("mean after < before", "0.383 < 1.923", "after_mean", "before_mean", worlds=ALL),
        Ordering("largest after < before", "1.153 < 4.715", "after_max", "before_max", worlds=ALL),
    ),
)

SIMULATION = Section(
    "Its simulation: the errors of its table 2, no noise; distances to the sphere, mm",
    (
        Figure("radians and metres, about the true centre: mean before", "3.657", "rad_m_before_mean"),
        Figure("the same: largest before", "5.559", "rad_m_before_max"),
        Figure("radians and metres, about the fitted centre: mean before", "3.657", "rad_m_fitted_centre_before_mean"),
        Figure("radians and metres: mean after", "0.665", "rad_m_after_mean", 4, NO_NOISE),
        Figure("the same: largest after", "1.104", "rad_m_after_max", 4, NO_NOISE),
        Figure("degrees and millimetres, about the true centre: mean before", "3.657", "deg_mm_before_mean"),
        Figure("degrees and millimetres: mean after", "0.665", "deg_mm_after_mean", 4, NO_NOISE),
    ),
)

WORKSPACE = Section(
    "The residual on the sphere is not the accuracy of the robot",
    (
        Figure("identified parameters", "28", "free", digits=0, note="24 links, 3 tool, 1 deflection, 3 centre"),
        Figure("of these unobservable combinations", "not stated", "unobservable", digits=1, note=UNOBSERVABLE),
        Figure("volumetric 3-D RMS before, mm", "not stated", "volumetric_before"),
        Figure("volumetric 3-D RMS after, mm", "not stated", "volumetric_after"),
        Figure("the same without a prior, mm", "not stated", "no_prior_volumetric_after", note="the published fit"),
        Ordering("held-out residual < volumetric error", "not stated", "after_mean", "volumetric_after"),
        Ordering(
            "volumetric error, with prior < without", "not stated", "volumetric_after", "no_prior_volumetric_after"
        ),
    ),
)

DESCRIPTIONS = Section(
    "DH, MDH and POE on the same 50 touches, mm",
    (
        Figure("held-out mean, MDH with β", "0.383", "mdh_after_mean"),
        Figure("held-out mean, POE", "", "poe_after_mean"),
        Figure("held-out mean, DH without β", "", "dh_after_mean"),
        Ordering("held-out mean, MDH with β < DH", "DH is singular", "mdh_after_mean", "dh_after_mean", 3, (LARGE,)),
        Ordering("held-out mean, POE < DH", "not stated", "poe_after_mean", "dh_after_mean", 3, (LARGE,)),
        Ordering(
            "volumetric, MDH with β < DH", "not stated", "mdh_volumetric_after", "dh_volumetric_after", 3, (LARGE,)
        ),
        Ordering("volumetric, POE < DH", "not stated", "poe_volumetric_after", "dh_volumetric_after", 3, (LARGE,)),
        Ordering(
            "volumetric, MDH with β < POE", "not stated", "mdh_volumetric_after", "poe_volumetric_after", 3, (LARGE,)
        ),
    ),
)

CONSTRAINTS = Section(
    "Sphere, plane, point and distance: volumetric error after 50 touches, mm",
    (
        Ordering("sphere < plane", "claimed", "sphere", "plane"),
        Ordering("sphere < point", "claimed", "sphere", "point", worlds=(BY_HAND,)),
        Ordering("sphere < distance (rod)", "claimed", "sphere", "rod", worlds=(POOR_LENGTH,)),
        Ordering("sphere < distance (draw-wire)", "claimed", "sphere", "wire", worlds=(POOR_LENGTH,)),
    ),
)

PAPER = Paper(
    "sph",
    "Spherical constraint (Wang et al. 2024)",
    "python -m tests.studies papers --papers sph",
    study,
    (HELD_OUT_TOUCHES, SIMULATION, WORKSPACE, DESCRIPTIONS, CONSTRAINTS),
)
