"""The scene of a run: what it shows is what the journal holds."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.console.scene._content import Kind, SceneContent, scene_of
from cellctl.console.scene.run_points import Points, Role
from cellctl.journal import RunState
from tests.helpers.journals import (
    REACH,
    SPHERES,
    STATION,
    TRACKER_CELL,
    MadeJournal,
    readings_at,
    reflector_arm,
    residuals_row,
    seen,
    station_row,
    touch_places,
    touch_row,
    touch_run,
    visited_row,
)
from tests.helpers.own_model import kr5
from tests.helpers.simulated_setups import KR5_SIGNS


def group(content: SceneContent, name: str, role: Role) -> Points:
    return next(each for each in content.points if each.name == name and each.role is role)


def names_of(content: SceneContent) -> set[tuple[str, str]]:
    return {(each.name, str(each.role)) for each in content.points}


def test_the_ends_of_the_links_are_those_of_an_independent_robot() -> None:
    content = scene_of(touch_run(8, 5).state())
    assert content.posture
    q = np.radians([content.posture.readings]) * KR5_SIGNS
    arm = kr5()
    expected = np.concatenate([arm.links(q)[0], arm.poses(q)])
    np.testing.assert_allclose(content.posture.frames[:, :3, 3], expected[:, :3, 3], atol=1e-6)


def test_the_robot_is_where_it_was_recorded_last() -> None:
    run = touch_run(8, 5)
    posture = scene_of(run.state()).posture
    assert posture
    assert list(posture.readings) == run.events[-1].data["resting"]
    assert posture.source == "recorded with touch 4"


def test_before_anything_is_recorded_the_robot_is_at_home() -> None:
    posture = scene_of(MadeJournal().state()).posture
    assert posture
    assert posture.readings == (0, -90, 90, 0, 45, 0)


def test_touches_are_where_the_tcp_was_and_the_others_are_still_to_come() -> None:
    content = scene_of(touch_run(planned=20, measured=8).state())
    _, places, _ = touch_places(20)
    fit, held_out = group(content, "touch", Role.FIT), group(content, "touch", Role.HELD_OUT)
    np.testing.assert_allclose(fit.at, places[[0, 1, 2, 4, 5, 6]], atol=1e-6)
    np.testing.assert_allclose(held_out.at, places[[3, 7]], atol=1e-6)
    coming = group(content, "planned touch", Role.HELD_OUT)
    assert coming.label == ["11", "15", "19"]
    assert (coming.seq == 0).all()


def test_a_coming_touch_is_on_its_sphere() -> None:
    content = scene_of(touch_run(planned=9, measured=0).state())
    names, _, _ = touch_places(9)
    for coming in content.points:
        centres = [SPHERES[names[int(label)]] for label in coming.label]
        np.testing.assert_allclose(np.linalg.norm(coming.at - centres, axis=1), REACH, atol=1e-6)


def test_before_the_identification_a_residual_is_the_distance_from_the_sphere_through_the_touches() -> None:
    names, places, normals = touch_places(30)
    places[6] += 0.5 * normals[6]
    run = MadeJournal()
    for number, readings in enumerate(readings_at(places)):
        run.row("touch", touch_row(number, names[number], readings))
    fit = group(scene_of(run.state()), "touch", Role.FIT)
    others = [residual for label, residual in zip(fit.label, fit.before, strict=True) if label != "6"]
    assert fit.before[fit.label.index("6")] == pytest.approx(0.5, abs=0.25)
    assert max(others) < 0.25
    assert np.isnan(fit.after).all()


def test_after_the_identification_every_touch_has_both_residuals() -> None:
    run = touch_run(planned=12, measured=12)
    readings = [event.data["joints"] for event in run.events[3:]]
    before, after = np.linspace(1.0, 2.0, 12), np.linspace(0.01, 0.02, 12)
    run.row("residuals", residuals_row(readings, before.tolist(), after.tolist()))
    held_out = group(scene_of(run.state()), "touch", Role.HELD_OUT)
    np.testing.assert_allclose(held_out.before, before[3::4])
    np.testing.assert_allclose(held_out.residual, after[3::4])


def poses_run(count: int) -> tuple[MadeJournal, list[list[float]], np.ndarray]:
    places = np.random.default_rng(1).uniform([700, -500, 300], [1100, 500, 1000], (count, 3))
    readings = readings_at(places, reflector_arm())
    run = MadeJournal(TRACKER_CELL)
    run.row("station", station_row())
    return run, readings, places


def test_the_instrument_is_where_the_run_found_it() -> None:
    rough = {body.name: body for body in scene_of(MadeJournal(TRACKER_CELL).state()).bodies}
    run, *_ = poses_run(1)
    found = {body.name: body for body in scene_of(run.state()).bodies}
    assert rough["instrument"].at == (3400, -1200, 900)
    assert not rough["instrument"].found
    np.testing.assert_allclose(found["instrument"].at, STATION[:3, 3])
    assert found["instrument"].found


def test_a_pose_is_at_its_reflector_with_the_residual_of_the_nominal_robot() -> None:
    run, readings, places = poses_run(12)
    off = np.zeros(3)
    for number, place in enumerate(places):
        off[2] = 2.0 if number == 5 else 0.0
        run.row("pose", {**visited_row(number, readings[number], seen(place + off)), "set": "fit", "others": []})
    poses = group(scene_of(run.state()), "pose", Role.FIT)
    np.testing.assert_allclose(poses.at, places, atol=1e-6)
    assert int(np.argmax(poses.before)) == 5
    assert poses.before[5] == pytest.approx(2.0, abs=1.0)


def test_a_compensated_target_has_the_distance_from_its_intended_place_as_error() -> None:
    run, readings, places = poses_run(2)
    run.row("pose", {**visited_row(0, readings[0], seen(places[0])), "set": "test", "others": []})
    target = np.add(seen(places[0]), [0.0, 0.3, 0.0]).tolist()
    run.row("compensated", {**visited_row(0, readings[0], seen(places[0])), "row": 1, "target": target})
    found = group(scene_of(run.state()), "compensated target", Role.TARGET)
    assert found.after[0] == pytest.approx(0.3)


def test_a_pose_of_the_iso_cube_has_its_deviation_once_the_test_is_evaluated() -> None:
    run, readings, places = poses_run(5)
    for place in range(5):
        visit = {"when": "before", "cycle": 0, "place": place, "side": 0, "others": []}
        run.row("iso pose", {**visited_row(place, readings[place], seen(places[place])), **visit})
    assert np.isnan(group(scene_of(run.state()), "cube before", Role.TARGET).before).all()
    deviations = [[[0.0, 3.0, 4.0 + place] for place in range(5)]]
    run.row("iso 9283", {"when": "before", "figures": {"left_out": 0}, "deviations": deviations})
    found = group(scene_of(run.state()), "cube before", Role.TARGET)
    assert found.before[0] == pytest.approx(5.0)
    assert (np.diff(found.before) > 0).all()


def test_contacts_of_a_tool_have_errors_with_the_taught_and_with_the_found_tool() -> None:
    run = MadeJournal()
    for number, readings in enumerate(readings_at(touch_places(3)[1])):
        run.row("tool_pose", {"number": number, "joints": readings})
    errors = {"orientation": [0, 1, 2], "held_out": [True] * 3, "taught": [1.0, -2.0, 3.0], "found": [0.1, 0.2, -0.3]}
    run.row("tool_errors", errors)
    poses = group(scene_of(run.state()), "pose", Role.HELD_OUT)
    assert (poses.before.tolist(), poses.after.tolist()) == ([1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    assert poses.compared == ("taught tool", "found tool")


def test_reflectors_move_with_the_flange() -> None:
    run, readings, places = poses_run(1)
    run.row("return", visited_row(0, readings[0], seen(places[0])))
    reflectors = [body for body in scene_of(run.state()).bodies if body.kind is Kind.REFLECTOR]
    np.testing.assert_allclose(reflectors[0].at, places[0], atol=1e-6)


def test_a_campaign_of_unknown_rows_shows_its_robot() -> None:
    run = MadeJournal()
    run.row("laser scan", {"joints": [0, -80, 80, 0, 40, 0], "points": 7})
    content = scene_of(run.state())
    assert content.posture
    assert content.posture.readings == (0, -80, 80, 0, 40, 0)
    assert content.points == ()


def test_a_damaged_row_is_named_and_the_robot_is_shown() -> None:
    run = touch_run(8, 5)
    run.row("touch", {"number": 5})
    content = scene_of(run.state())
    assert "a row is without 'joints'" in content.problems[0]
    assert content.posture


def test_a_run_that_has_not_begun_shows_nothing_and_says_so() -> None:
    content = scene_of(RunState())
    assert content.posture is None
    assert content.problems == ("The run has not begun.",)
