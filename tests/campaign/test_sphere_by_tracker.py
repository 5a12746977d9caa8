"""The sphere calibration judged by the tracker, over the wires of the simulated cell that has both."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from cellctl.formats import ModelFile
from cellctl.journal import fold, read_journal
from procedures.steps.by_tracker.verdict import ByTrackerVerdict, JudgedPosesRow
from tests.helpers.runs import FASTEST, ROOT, cellctl, quick_cell

pytestmark = [pytest.mark.campaign, pytest.mark.long]

SEED = 1
CELL = ROOT / "procedures" / "cells" / "sphere_tracker_cell.yaml"
FEWER = {"touches_test": 8, "poses_register": 20, "poses_test": 20, "samples": 2}
"""Than in a whole campaign; the touches that identify are all there."""


@dataclass(frozen=True)
class Done:
    """A campaign that the command line ran: exit code, result, run folder."""

    code: int
    result: dict[str, Any]
    run: Path


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Done:
    folder = tmp_path_factory.mktemp("by_tracker")
    settings = [*(f"{name}={value}" for name, value in FEWER.items()), *FASTEST]
    words = [word for setting in settings for word in ("--set", setting)]
    result = folder / "result.json"
    places = ("--cell", quick_cell(folder, shipped=CELL), "--runs", folder, "--json", result)
    ended = cellctl("run", "sphere_by_tracker", "--seed", str(SEED), *words, *places)
    assert ended.returncode in (0, 1), ended.stderr
    content = json.loads(result.read_text())
    return Done(ended.returncode, content, folder / content["run"])


def test_touches_and_poses_of_one_arm_end_in_a_verdict_by_the_tracker(done: Done) -> None:
    assert done.result["state"] == "finished"
    assert done.result["points"] == 50 + 8 + 20 + 20
    figures = done.result["by_tracker"]
    assert (figures["n_fit"], figures["n_test"]) == (20, 20)
    assert done.result["before"] == figures["nominal"]["errors"]
    assert done.result["after"] == figures["touches"]["errors"]
    assert done.code == (0 if done.result["verdict"] == "better" else 1)
    state = fold(read_journal(done.run))
    assert state.last(ByTrackerVerdict) is not None
    poses = state.last(JudgedPosesRow)
    assert poses is not None
    assert len(poses.place) == 20


def test_nothing_is_pushed_and_the_model_file_is_that_of_the_touches(done: Done) -> None:
    state = fold(read_journal(done.run))
    assert not state.data_of("push")
    assert done.result["table"] is None
    assert [centre.id for centre in ModelFile.load(done.run / "model.json").centres] == ["S1", "S2", "S3"]
    assert not ModelFile.load(done.run / "tracker_model.json").centres


def test_the_report_shows_the_three_models_and_replay_finds_the_same_figures(done: Done) -> None:
    page = (done.run / "report.html").read_text()
    assert "Judged by the tracker" in page
    for words in ("nominal robot", "model from the touches", "accuracy profile tdra6000"):
        assert words in page
    again = cellctl("replay", done.run)
    assert again.returncode == 0, again.stdout


def test_the_tracker_finds_the_model_from_the_touches_better_than_nominal_by_far(done: Done) -> None:
    figures = done.result["by_tracker"]
    assert (done.code, done.result["verdict"]) == (0, "better")
    assert figures["touches"]["errors"]["rms"] < figures["nominal"]["errors"]["rms"] / 4
    assert 0.5 < figures["touches"]["predicted_rms"] / figures["touches"]["errors"]["rms"] < 2.0
    scale = figures["touches"]["directions"]
    assert abs(scale["scale_ppm"]) < 300.0 + 3 * scale["scale_sigma_ppm"]
