"""The sphere calibration judged by the tracker, over the wires of the simulated cell that has both."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from cell_runs import cellctl

from cellctl.formats import ModelFile
from cellctl.journal import fold, read_journal
from procedures.steps.by_tracker.rows import ByTrackerVerdict, JudgedPosesRow

pytestmark = [pytest.mark.campaign, pytest.mark.long]

FEW = {
    "touches_fit": 18,
    "touches_test": 5,
    "reference_every": 0,
    "poses_register": 10,
    "poses_test": 6,
    "monuments_every": 8,
    "samples": 1,
}


@dataclass(frozen=True)
class Done:
    """A campaign that the command line ran: exit code, result, run folder."""

    code: int
    result: dict[str, Any]
    run: Path


def campaign(folder: Path, seed: int, **settings: int) -> Done:
    words = [word for name, value in settings.items() for word in ("--set", f"{name}={value}")]
    result = folder / "result.json"
    done = cellctl("run", "sphere_by_tracker", "--seed", str(seed), *words, "--runs", folder, "--json", result)
    assert done.returncode in (0, 1), done.stderr
    content = json.loads(result.read_text())
    return Done(done.returncode, content, folder / content["run"])


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Done:
    return campaign(tmp_path_factory.mktemp("short"), 1, **FEW)


def test_touches_and_poses_of_one_arm_end_in_a_verdict_by_the_tracker(short: Done) -> None:
    assert short.result["state"] == "finished"
    assert short.result["points"] == 18 + 5 + 10 + 6
    figures = short.result["by_tracker"]
    assert (figures["n_fit"], figures["n_test"]) == (10, 6)
    assert short.result["before"] == figures["nominal"]["errors"]
    assert short.result["after"] == figures["touches"]["errors"]
    assert short.code == (0 if short.result["verdict"] == "better" else 1)
    state = fold(read_journal(short.run))
    assert state.last(ByTrackerVerdict) is not None
    poses = state.last(JudgedPosesRow)
    assert poses is not None
    assert len(poses.place) == 6


def test_nothing_is_pushed_and_the_model_file_is_that_of_the_touches(short: Done) -> None:
    state = fold(read_journal(short.run))
    assert not state.data_of("push")
    assert short.result["table"] is None
    assert [centre.id for centre in ModelFile.load(short.run / "model.json").centres] == ["S1", "S2", "S3"]
    assert not ModelFile.load(short.run / "tracker_model.json").centres


def test_the_report_shows_the_three_models_and_replay_finds_the_same_figures(short: Done) -> None:
    page = (short.run / "report.html").read_text()
    assert "Judged by the tracker" in page
    for words in ("nominal robot", "model from the touches", "accuracy profile tdra6000"):
        assert words in page
    again = cellctl("replay", short.run)
    assert again.returncode == 0, again.stdout


def test_the_tracker_finds_the_model_from_the_touches_better_than_nominal_by_far(tmp_path: Path) -> None:
    done = campaign(tmp_path, 1)
    figures = done.result["by_tracker"]
    assert (done.code, done.result["verdict"]) == (0, "better")
    assert figures["touches"]["errors"]["rms"] < figures["nominal"]["errors"]["rms"] / 4
    assert 0.5 < figures["touches"]["predicted_rms"] / figures["touches"]["errors"]["rms"] < 2.0
    scale = figures["touches"]["directions"]
    assert abs(scale["scale_ppm"]) < 300.0 + 3 * scale["scale_sigma_ppm"]
