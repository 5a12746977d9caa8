"""Tours of touches on the shipped robot: returns to a reference, spheres that are only kept clear of, clear ways."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cellctl.formats import RobotFile
from cellctl.planning import BestTouches, OutOfReach, PlannedTouch, SphereTarget, TouchOptions, plan_touches
from cellctl.planning.ways import Reach
from tests.helpers.arms import KR5_POSTURES

ROBOT = RobotFile.load(Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml")
SPHERES = [SphereTarget("S1", (950.0, -350.0, 250.0), 31.3), SphereTarget("P1", (850.0, 0.0, 550.0), 31.3)]
LIMITS = Reach(*(tuple(column) for column in ROBOT.limits().T.tolist()))
CLEARANCE_MM = TouchOptions().clearance


def tour(counts: list[int], every: int = 0, reference: PlannedTouch | None = None, reach: Reach = LIMITS):
    return plan_touches(
        ROBOT.chain(),
        ROBOT.joint_map(),
        reach,
        KR5_POSTURES,
        SPHERES,
        counts,
        3,
        reference_every=every,
        reference=reference,
    )


def way(touches: list[PlannedTouch]) -> list[tuple[str, tuple[float, ...], tuple[float, ...]]]:
    """Every transfer with the tip clear of the spheres: what is touched next, from, to."""
    lines, here = [], KR5_POSTURES.home
    for touch in touches:
        for there in touch.approach:
            lines.append((touch.sphere, here, there))
            here = there
        here = touch.retreat[1]
        lines += [(touch.sphere, a, b) for a, b in pairwise(touch.retreat[1:])]
    return lines


def tool_to_sphere_mm(start, end, sphere: SphereTarget) -> float:
    """Least distance from the tool's shaft to the sphere's surface on a joint-space line, by brute force."""
    q = ROBOT.joint_map().model(np.linspace(start, end, 60))
    flange, tip = ROBOT.chain().forward_flange(q)[:, :3, 3], ROBOT.chain().forward(q)[:, :3, 3]
    shares = np.linspace(0.0, 1.0, 60)[:, None, None]
    points = flange + shares * (tip - flange)
    return float(np.linalg.norm(points - np.array(sphere.centre), axis=-1).min()) - sphere.contact_radius


def test_the_best_of_more_candidates_join_the_tour_and_are_marked() -> None:
    seen = []

    def choose(spheres, readings):
        seen.append((spheres, readings))
        return np.array([1, 4])

    plain = tour([3, 2])
    touches = plan_touches(
        ROBOT.chain(),
        ROBOT.joint_map(),
        LIMITS,
        KR5_POSTURES,
        SPHERES,
        [3, 2],
        3,
        best=BestTouches((4, 2), choose),
        reference_every=3,
    )
    [(spheres, readings)] = seen
    assert spheres.tolist() == [0] * 4 + [1] * 2
    chosen = [touch for touch in touches if touch.chosen]
    assert {touch.end for touch in touches if not touch.chosen and not touch.reference} == {each.end for each in plain}
    assert sorted(touch.sphere for touch in chosen) == ["P1", "S1"]
    share = TouchOptions().guard / (TouchOptions().guard + TouchOptions().depth)
    contacts = {tuple(np.round(np.array(t.start) + share * (np.array(t.end) - t.start), 3)) for t in chosen}
    assert contacts == {tuple(np.round(readings[at], 3)) for at in (1, 4)}


def test_after_every_so_many_touches_the_tour_returns_to_the_first_one_along_the_same_line() -> None:
    touches = tour([11, 0], every=4)
    assert [touch.reference for touch in touches] == [False] * 4 + [True] + [False] * 4 + [True] + [False] * 3
    first = touches[0]
    for again in (touch for touch in touches if touch.reference):
        assert (again.sphere, again.start, again.end) == (first.sphere, first.start, first.end)
        assert again.retreat[:2] == first.retreat[:2]


def test_a_reference_of_another_tour_is_returned_to() -> None:
    first = tour([3, 0])[0]
    touches = tour([0, 4], every=2, reference=first)
    assert [touch.sphere for touch in touches] == ["P1", "P1", "S1", "P1", "P1", "S1"]
    assert {(touch.start, touch.end) for touch in touches if touch.reference} == {(first.start, first.end)}


def test_without_references_there_are_none() -> None:
    assert not any(touch.reference for touch in tour([5, 0]))


def test_a_sphere_without_touches_is_still_kept_clear_of() -> None:
    touches = tour([12, 0], every=5)
    assert {touch.sphere for touch in touches} == {"S1"}
    assert min(tool_to_sphere_mm(a, b, SPHERES[1]) for _, a, b in way(touches)) > CLEARANCE_MM - 1.0


def test_all_transfers_between_spheres_are_clear_of_both_and_begin_and_end_at_home() -> None:
    touches = tour([6, 6], every=3)
    for _, start, end in way(touches):
        for sphere in SPHERES:
            assert tool_to_sphere_mm(start, end, sphere) > CLEARANCE_MM - 1.0
    assert touches[-1].retreat[-1] == KR5_POSTURES.home


def test_touches_stay_within_the_joint_readings_that_are_asked_for() -> None:
    seen = np.array([touch.start for touch in tour([40, 0])])
    low, high = seen.min(axis=0), seen.max(axis=0)
    touches = tour([0, 6], reach=Reach(tuple(low), tuple(high), margin=0.0))
    for touch in touches:
        for joints in (touch.start, touch.end, touch.retreat[1]):
            assert (np.array(joints) >= low - 1e-3).all()
            assert (np.array(joints) <= high + 1e-3).all()


def test_too_few_reachable_touches_are_an_error_that_names_the_sphere() -> None:
    narrow = Reach(tuple(np.full(6, -1.0)), tuple(np.full(6, 1.0)), margin=0.0)
    with pytest.raises(OutOfReach, match="P1"):
        tour([0, 4], reach=narrow)
