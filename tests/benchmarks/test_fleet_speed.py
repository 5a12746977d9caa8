"""The charts of a fleet by the index of runs beside reading the models of all runs."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from cellctl.operations.fleet import fleet
from cellctl.run_index import IndexedParameter, IndexedRun, opened_index
from tests.helpers.arms import kr5_model

ROBOTS, RUNS, LEAST_RATIO = 20, 100, 2.0
"""300 robots with 75 000 models take minutes to make. The cost of a robot is the same: its last runs alone are read."""


@pytest.mark.long
def test_the_charts_of_a_fleet_cost_less_than_reading_the_models(tell: Callable[..., None], tmp_path: Path) -> None:
    model = kr5_model().model_dump(mode="json")
    text, rng = json.dumps(model), np.random.default_rng(1)
    known = [each for each in model["parameters"] if 0.0 < each["sigma"] < each["prior_sigma"]]

    def run(robot: int, number: int) -> IndexedRun:
        parameters = (IndexedParameter(**{**each, "value": each["sigma"] * rng.normal()}) for each in known)
        return IndexedRun(
            run=f"run-{robot}-{number}",
            fingerprint="made",
            settled=True,
            began=(datetime(2026, 1, 1) + timedelta(days=number)).isoformat() + "Z",
            state="finished",
            robot_type=f"KR{robot % 3}",
            serial=f"{robot}",
            has_model=True,
            simulated=True,
            content="{}",
            parameters=tuple(parameters),
        )

    with opened_index(tmp_path) as index:
        for robot in range(ROBOTS):
            index.put([run(robot, number) for number in range(RUNS)])
        began = time.process_time()
        found = fleet(index, tmp_path)
        ours = time.process_time() - began
    assert len(found.robots) == ROBOTS
    assert all(robot.charts > 20 and robot.runs == RUNS for robot in found.robots)
    began = time.process_time()
    for _ in range(ROBOTS * RUNS):
        json.loads(text)
    models = time.process_time() - began
    ratio = models / ours
    tell(
        f"fleet of {ROBOTS} robots, {ROBOTS * RUNS} models",
        f"{1e3 * ours:.0f} ms, {1e3 * ours / ROBOTS:.1f} ms a robot",
        f"models alone {models:.2f} s",
        f"{ratio:.0f} ×",
        f"> {LEAST_RATIO:g} ×",
    )
    assert ratio > LEAST_RATIO
