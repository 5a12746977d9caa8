"""A whole campaign replayed: killed and resumed, moved elsewhere, its cell gone; and with an edited model."""

from __future__ import annotations

import json
import platform
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cellctl.journal import JournalError, RunResumed, fold, read_journal
from cellctl.operations.launch import versions
from tests.helpers.runs import (
    FASTEST,
    PATIENCE_S,
    ROOT,
    SELFCAL,
    cell_with,
    cellctl,
    cellctl_process,
    only_run,
    shared_campaign,
)

pytestmark = pytest.mark.campaign

FEW = ("touches_fit=24", "touches_test=8", "standoff_targets=12", "reference_every=12", *FASTEST)
FILES = ["dataset.csv", "model.json", "table.json"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The run folder of a campaign that was killed in a touch and resumed, moved; what it was made from is gone."""
    home, away = tmp_path_factory.mktemp("home"), tmp_path_factory.mktemp("away")
    robots = ROOT / "procedures" / "robots"
    shutil.copy(robots / "kr5_r1400.yaml", home)
    cell = cell_with(home, replace={f"{robots}/": ""})
    settings = [word for setting in FEW for word in ("--set", setting)]
    common = [str(SELFCAL), "--cell", str(cell), "--runs", str(home / "runs"), *settings]
    folder = killed(common, home / "runs")
    done = cellctl("run", *common, "--resume", folder.name, "--acknowledge", "--json", away / "result.json")
    assert done.returncode == 0, done.stderr
    assert any(isinstance(entry.event, RunResumed) for entry in read_journal(folder))
    moved = shutil.move(folder, away / "another name")
    shutil.rmtree(home)
    return Path(moved)


def killed(common: list[str], runs: Path) -> Path:
    """The run folder of a campaign, killed (-9) as soon as three touches are recorded."""
    command = [sys.executable, "-m", "cellctl", "run", *common]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        until = time.monotonic() + PATIENCE_S
        while touches(runs) < 3:
            assert process.poll() is None, process.communicate()[1]
            assert time.monotonic() < until
            time.sleep(0.1)  # noqa: TID251 - another process, in wall time
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=PATIENCE_S)
    return only_run(runs)


def touches(runs: Path) -> int:
    journal = next(runs.glob("*/journal.sqlite"), None)
    try:
        return len(fold(read_journal(journal)).data_of("touch")) if journal else 0
    except JournalError:  # it is just being made
        return 0


def test_after_kill_and_resume_the_model_is_better_on_held_out_touches_and_its_pushed_joints_on_another_sphere(run):
    """The short sibling of the campaigns in `test_self_calibration`, whose bounds are those of all touches."""
    result = json.loads((run.parent / "result.json").read_text())
    assert (result["verdict"], result["state"], result["points"]) == ("better", "finished", 32)
    assert result["model"]["n_fit"] + len(result["model"]["outliers"]) == 24
    assert result["held_out"]["before"]["mean"] >= 0.5
    assert result["held_out"]["after"]["mean"] <= 0.3
    assert (result["standoff"]["n"], result["standoff"]["sphere"]) == (12, "P1")
    assert result["after"]["mean"] <= 0.5 * result["before"]["mean"]
    table = result["table"]
    assert (table["rows"], table["pushed"], table["verified"], table["active"]) == (12, True, True, True)


def test_data_set_model_table_and_results_are_equal_byte_for_byte(run, tmp_path):
    done = cellctl_process("replay", run, "-o", tmp_path / "again", "--json", tmp_path / "replay.json")
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads((tmp_path / "replay.json").read_text())
    assert found["equal"] is True
    assert found["changed"] == []
    assert [each["name"] for each in found["artefacts"]] == FILES
    assert {each["folder"] for each in found["artefacts"]} == {"as recorded"}
    assert [each["step"] for each in found["steps"]] == ["plan", "identify", "proof", "compensation"]
    assert "model.json    equal (sha256 " in done.stdout
    for name in FILES:
        assert (tmp_path / "again" / name).read_bytes() == (run / name).read_bytes()


def test_on_another_processor_the_run_is_equal_within_the_tolerance(run, tmp_path, monkeypatch):
    monkeypatch.setenv("OPENBLAS_CORETYPE", other_kernel())
    done = cellctl_process("replay", run, "--json", tmp_path / "replay.json")
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads((tmp_path / "replay.json").read_text())
    assert found["agreement"].startswith("equal within the stated tolerance")
    assert found["changed"][0].startswith("BLAS openblas")


def other_kernel() -> str:
    """A kernel of OpenBLAS that every x86-64 has, and that this process does not use; skips elsewhere."""
    used = versions()["BLAS"]
    if platform.machine() != "x86_64" or "openblas" not in used:
        pytest.skip(f"no second kernel is known for {platform.machine()}, {used}")
    return "Prescott" if "Nehalem" in used else "Nehalem"


@pytest.mark.long
def test_an_edited_model_is_told_apart_from_a_replay_that_differs(run, tmp_path):
    edited = tmp_path / "edited"
    shutil.copytree(run, edited)
    content = (edited / "model.json").read_bytes()
    place = content.index(b'"format":') + len('"format":')
    (edited / "model.json").write_bytes(content[:place] + b" " + content[place:])
    done = cellctl_process("replay", edited)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "model.json    equal to the journal (sha256 " in done.stdout
    assert f"first at byte {place + 1} (line 1): " in done.stdout
    assert "why: the file in the run folder was changed after the run" in done.stdout
    assert "table.json    equal (sha256 " in done.stdout


def test_the_run_folder_itself_is_no_place_for_the_files_of_a_replay(run):
    refused = cellctl_process("replay", run, "-o", run)
    assert refused.returncode == 2
    assert "is the run folder: its files would be written over" in refused.stderr


def test_a_folder_without_a_run_is_refused(tmp_path):
    refused = cellctl_process("replay", tmp_path)
    assert refused.returncode == 2
    assert "there is no journal" in refused.stderr


@pytest.mark.long
def test_the_shipped_campaign_is_replayed_byte_for_byte(tmp_path_factory, tmp_path):
    run = shared_campaign(tmp_path_factory).run
    done = cellctl_process("replay", run, "--json", tmp_path / "replay.json")
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads((tmp_path / "replay.json").read_text())
    assert [each["name"] for each in found["artefacts"]] == FILES
