"""The touches that locate the proof sphere surround it, also where the joints of the fit leave little room."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cellctl.files import load_yaml
from cellctl.formats import RobotFile, artefact_of
from cellctl.planning.ways import Reach
from procedures.steps.sphere import planning
from procedures.steps.sphere.planning import locating_touches
from tests.helpers.runs import ROOT
from tests.helpers.steps import touch

ROBOT_FILE = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
CELL = load_yaml(ROOT / "procedures" / "cells" / "sphere_cell.yaml")
PROOF = artefact_of(CELL, ("artefact",)).sphere("P1")
JOINTS_OF_FITS = {
    20: ((-51.36, -76.81, 55.94, -172.55, -100.53, -157.8), (43.79, -37.26, 134.98, 153.2, 104.22, 175.75)),
    24: ((-51.36, -87.75, 51.72, -172.55, -95.67, -176.33), (43.79, -29.99, 134.98, 169.7, 104.38, 166.22)),
}
"""By the number of touches of two campaigns with seed 3: their first eight touches in reach were on one side."""


@pytest.mark.parametrize("fitted", JOINTS_OF_FITS)
def test_a_touch_error_enters_the_located_centre_hardly_magnified(fitted: int, monkeypatch: Any) -> None:
    monkeypatch.setattr(planning, "_seen", lambda _: Reach(*JOINTS_OF_FITS[fitted], margin=0.0))
    context: Any = SimpleNamespace(cell=CELL, robot_file=ROBOT_FILE, seed=3, recorded=lambda *_: [touch(number=33)])
    touches = locating_touches(context, "P1", 8, tried=4)
    assert [each.number for each in touches] == [*range(34, 42)]
    assert PROOF is not None
    robot = RobotFile.load(ROBOT_FILE)
    tips = robot.chain().forward(robot.joint_map().model([each.start for each in touches]))[:, :3, 3]
    normals = (tips - PROOF.centre) / np.linalg.norm(tips - PROOF.centre, axis=1)[:, None]
    magnified = float(np.sqrt(np.trace(np.linalg.inv(normals.T @ normals))))  # 1.06 with eight evenly all around
    assert magnified < 1.3
