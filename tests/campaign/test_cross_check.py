"""Spheres and tracker calibrate one robot in one cell, over the wires; the verdict says whether they agree."""

from __future__ import annotations

import json
from html import unescape
from pathlib import Path

import pytest

from cellctl.formats import ModelFile
from tests.helpers.runs import FASTEST, ROOT, cellctl, quick_cell

pytestmark = [pytest.mark.campaign, pytest.mark.long]

CELL = ROOT / "procedures" / "cells" / "sphere_tracker_cell.yaml"
FEWER = {"touches_fit": 50, "touches_test": 8, "poses_fit": 30, "poses_test": 8, "samples": 2}
"""Than in a whole campaign."""


def test_a_cross_check_ends_in_a_verdict_with_both_models_and_replays_to_the_same(tmp_path: Path) -> None:
    settings = [*(f"{name}={value}" for name, value in FEWER.items()), *FASTEST]
    words = [word for setting in settings for word in ("--set", setting)]
    places = ("--cell", quick_cell(tmp_path, shipped=CELL), "--runs", tmp_path, "--json", tmp_path / "r.json")
    ended = cellctl("run", "cross_check", "--seed", "1", *words, *places)
    assert ended.returncode in (0, 1), ended.stderr
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["state"] == "finished"
    assert result["points"] == 50 + 8 + 30 + 8
    assert (result["verdict"] == "agree") == (ended.returncode == 0)
    assert result["agreement"]["verdict"] == result["verdict"]
    assert result["agreement"]["figures"]["scale_sigma_ppm"] > 0.0
    run = tmp_path / result["run"]
    assert ModelFile.load(run / "model.json").centres
    assert not ModelFile.load(run / "tracker_model.json").centres
    assert result["sentence"] in unescape((run / "report.html").read_text())
    again = cellctl("replay", run)
    assert again.returncode == 0, again.stdout
