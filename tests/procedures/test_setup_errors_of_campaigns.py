"""A campaign whose touches show a set-up error ends before the identification: what is wrong, where, and the cure."""

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellctl.files import InputError, load_yaml
from procedures.steps.sphere.touching import IdentifyInputs, identify
from tests.helpers.own_campaigns import Campaign
from tests.helpers.runs import ROOT, cell_with
from tests.helpers.simulated_setups import KR5_SIGNS
from tests.helpers.steps import Context, touch

SPHERES = np.array([[950.0, -350.0, 250.0], [950.0, 350.0, 250.0], [1150.0, 0.0, 400.0]])
CERTIFIED = {(0, 1): "700.412", (1, 2): "430.263", (0, 2): "430.018"}


def context(folder, cell, touches):
    """What the identify step looks at: cell, robot file, run folder and the recorded touches."""
    robot_file = folder / "robot.yaml"
    robot_file.write_text((ROOT / "procedures" / "robots" / "kr5_r1400.yaml").read_text())
    return Context(rows=list(touches), run_folder=folder, robot_file=robot_file, cell=load_yaml(cell))


@pytest.fixture(scope="module")
def touches():
    """80 touches on three spheres by a robot of the tests' own, as the journal holds them."""
    campaign = Campaign.of(5)
    campaign = replace(campaign, truth=replace(campaign.truth, base=np.eye(4)))
    rows = campaign.touches(80, SPHERES, 0.02)
    return [
        touch(
            number=number,
            sphere=f"S{point + 1}",
            set="fit" if number < 50 else "test",
            time_ns=number,
            joints=tuple(joints.tolist()),
            resting=tuple(joints.tolist()),
        )
        for number, (joints, point) in enumerate(
            zip(KR5_SIGNS * np.degrees(np.asarray(rows.q)), rows.point, strict=True)
        )
    ]


def cell(folder, **changes):
    """The shipped cell with the distances between these spheres certified, and with `changes` of its text."""
    true = {text: f"{np.linalg.norm(SPHERES[a] - SPHERES[b]):.3f}" for (a, b), text in CERTIFIED.items()}
    path = cell_with(folder, replace=true)
    text = path.read_text()
    for old, new in changes.items():
        text = text.replace(old, new)
    path.write_text(text)
    return path


def identified(folder, touches, **changes):
    """The verdict of the step, done as the engine does it."""
    run = context(folder, cell(folder, **changes), touches)
    asyncio.run(identify(run, IdentifyInputs(model="geometry")))
    return run.rows[-1]


def refused(folder, touches, **changes):
    with pytest.raises(InputError) as caught:
        identified(folder, touches, **changes)
    return caught.value


def test_touches_of_a_healthy_set_up_are_identified(tmp_path, touches):
    verdict = identified(tmp_path, touches)
    assert verdict.verdict == "better"
    assert (tmp_path / "model.json").is_file()


def test_a_reversed_joint_is_named_at_its_line_in_the_robot_file(tmp_path, touches):
    turned = [replace(row, joints=(*row.joints[:2], -row.joints[2], *row.joints[3:])) for row in touches]
    error = refused(tmp_path, turned)
    problem = error.problems[0]
    assert Path(problem.file).name == "robot.yaml"
    assert problem.line > 1
    assert problem.what.startswith("A3 reversed: RMS ")
    assert problem.cure.startswith("sign: -1 for joint 3 in ")


def test_spheres_of_another_size_are_named_at_the_cell_file(tmp_path, touches):
    error = refused(tmp_path, touches, **{"diameter: 61.4": "diameter: 122.8"})
    assert {Path(problem.file).name for problem in error.problems} == {"cell.yaml"}
    assert any("spheres: diameters are given as radii: RMS " in problem.what for problem in error.problems)


def test_a_wrong_certified_distance_is_named_at_its_line_in_the_cell_file(tmp_path, touches):
    error = refused(tmp_path, touches, **{"mm: 700.000": "mm: 705.000"})
    (problem,) = error.problems
    line = (tmp_path / "cell.yaml").read_text().splitlines()[problem.line - 1]
    assert "[S1, S2]" in line
    assert problem.what.startswith("spacing S1–S2: 705 mm given")


def test_the_touches_are_kept_and_the_message_says_how_to_identify_from_them(tmp_path, touches):
    error = refused(tmp_path, touches, **{"mm: 700.000": "mm: 705.000"})
    data = tmp_path / "dataset.csv"
    assert len(data.read_text().splitlines()) == 81
    assert f"cellctl fit {tmp_path / 'robot.yaml'} {data} --artefact {tmp_path / 'cell.yaml'}" in str(error)
