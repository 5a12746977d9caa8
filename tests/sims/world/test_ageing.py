"""Wear and warm-up against closed forms: a shorter tip along the flange's z, links that grow evenly from the base."""

from __future__ import annotations

import csv
import subprocess
import sys
from dataclasses import replace
from math import exp, hypot

import numpy as np
import pytest
import yaml

from sims.cell import ERRORS
from tests.helpers.sims import BENT, CELL, world

MINUTE_NS = 60_000_000_000
# the link table stretched out, base to flange: d1 and a1, a2, a3, d4, d6
STRETCHED_MM = hypot(180.0, 400.0) + 600.0 + 40.0 + 620.0 + 80.0


def with_tool(xyz):
    """The cell with this tool and no other difference: the flange itself is at xyz = 0, its z towards [0, 0, 1]."""
    tool = replace(CELL.robot.tool, xyz=xyz)
    return replace(CELL, robot=replace(CELL.robot, tool=tool))


FLANGE, AHEAD = with_tool((0.0, 0.0, 0.0)), with_tool((0.0, 0.0, 1.0))


def test_each_touch_takes_half_a_micrometre_off_the_tip_along_the_flanges_z():
    worn = world(wear=2)
    before = np.array(worn.true_tcp(BENT))
    for _ in range(100):
        worn.ageing.touched()
    z = np.subtract(world(cell=AHEAD).true_tcp(BENT), world(cell=FLANGE).true_tcp(BENT))
    assert worn.ageing.worn_mm == pytest.approx(0.1)
    assert np.array(worn.true_tcp(BENT)) - before == pytest.approx(-0.1 * z, abs=1e-9)


def test_without_wear_a_touch_takes_nothing():
    fresh = world()
    fresh.ageing.touched()
    assert fresh.ageing.worn_mm == 0.0


def test_a_shortened_tip_is_as_a_shorter_tool():
    short = world(deflection=0)
    short.ageing.shorten(0.7)
    x, y, z = CELL.robot.tool.xyz
    assert short.true_tcp(BENT) == pytest.approx(world(cell=with_tool((x, y, z - 0.7))).true_tcp(BENT), abs=1e-9)


@pytest.mark.parametrize("minutes", [0.0, 1.0, 20.0, 200.0])
@pytest.mark.parametrize("scale", [0.5, 1.0])
def test_links_grow_as_an_exponential_of_time_and_the_tool_does_not(minutes, scale):
    warm = world(warm_up=scale)
    warm.ageing.warm(round(minutes * MINUTE_NS))
    flange = np.array(world(cell=FLANGE).true_tcp(BENT))
    growth = scale * 0.08 / STRETCHED_MM * (1.0 - exp(-minutes / 20.0))
    assert np.subtract(warm.true_tcp(BENT), world().true_tcp(BENT)) == pytest.approx(growth * flange, abs=1e-9)


def test_stretched_out_and_warm_the_flange_is_off_by_the_figure_of_the_document():
    warm = world(cell=FLANGE, warm_up=1)
    warm.ageing.warm(1000 * MINUTE_NS)
    furthest = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    off = np.linalg.norm(np.subtract(warm.true_tcp(furthest), world(cell=FLANGE).true_tcp(furthest)))
    assert 0.8 * 0.08 < off <= 0.08


def test_a_robot_goes_on_as_warm_and_worn_as_it_remembers_being():
    before, after = world(warm_up=1, wear=1), world(warm_up=1, wear=1)
    before.ageing.touched()
    before.ageing.warm(10 * MINUTE_NS)
    after.ageing.recall(before.ageing.state(10 * MINUTE_NS))
    after.ageing.warm(0)
    assert after.true_tcp(BENT) == pytest.approx(before.true_tcp(BENT), abs=1e-12)
    after.ageing.warm(10 * MINUTE_NS)
    before.ageing.warm(20 * MINUTE_NS)
    assert after.true_tcp(BENT) == pytest.approx(before.true_tcp(BENT), abs=1e-12)


def test_the_truth_is_that_of_the_cold_robot_with_a_fresh_tip(tmp_path, request):
    source = request.config.rootpath / "procedures/cells/sphere_cell.yaml"
    cell = yaml.safe_load(source.read_text())
    cell["model"] = str(source.parent / cell["model"])
    cell["simulate"]["errors"] = {"wear": 100, "warm_up": 100}
    (tmp_path / "aged.yaml").write_text(yaml.safe_dump(cell))
    (tmp_path / "joints.csv").write_text("A1,A2,A3,A4,A5,A6\n" + ",".join(map(str, BENT)) + "\n")
    command = [sys.executable, "-m", "sims", "truth", tmp_path / "aged.yaml", tmp_path / "joints.csv"]
    subprocess.run([*command, "-o", tmp_path / "out.csv"], cwd=request.config.rootpath, check=True, timeout=600)
    with (tmp_path / "out.csv").open() as stream:
        (row,) = csv.DictReader(stream)
    usual = world(**ERRORS)  # neither wear nor warm-up
    assert [float(row[axis]) for axis in "XYZ"] == pytest.approx(usual.true_tcp(BENT), abs=1e-6)
