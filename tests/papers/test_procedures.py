"""The procedures of the papers fit their cells, and a run of each comes to a verdict over the wires."""

import json
from pathlib import Path

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.files import parse_yaml
from cellctl.journal import fold, read_journal
from procedures.steps.tracker.rows import ComparedModelsRow
from tests.helpers.runs import ROOT, cellctl, quick_cell

PAPERS = ROOT / "procedures" / "papers"
FEW_POSES = {
    "poses_fit": 24,
    "poses_test": 6,
    "turn_points": 5,
    "samples": 2,
    "warm_up_minutes": 0.05,
    "warm_up_limit": 2,
    "transfer_speed": 50,
}
FEW = {
    "spherical_constraint": {"touches_fit": 20, "touches_test": 8, "search_speed": 10, "transfer_speed": 50},
    "compensation_methods": {**FEW_POSES, "method": "newton-raphson"},
    "configuration_space_kriging": {**FEW_POSES, "pose_file": PAPERS / "targets" / "heavy_robot.csv"},
    "point_selection": {**FEW_POSES, "pose_file": PAPERS / "targets" / "flexible_arm.csv"},
}


PAPERS_MODEL = {"configuration_space_kriging": "kriging", "point_selection": "poe+motor+network"}


def settings(name: str) -> list[str]:
    return [word for key, value in FEW[name].items() for word in ("--set", f"{key}={value}")]


@pytest.mark.parametrize("name", FEW)
def test_the_procedure_fits_its_cell(name: str) -> None:
    file = str(PAPERS / f"{name}.yaml")
    assert exit_codes.exit_code_of(lambda: app(["check", file, *settings(name)], standalone_mode=False)) == 0


@pytest.mark.long
@pytest.mark.campaign
@pytest.mark.parametrize("name", FEW)
def test_a_small_run_is_better_than_nominal_and_its_replay_is_equal(name: str, tmp_path: Path) -> None:
    result = tmp_path / "result.json"
    procedure = PAPERS / f"{name}.yaml"
    shipped = procedure.parent / parse_yaml(procedure.read_text(), str(procedure)).data["cell"]
    places = ("--cell", quick_cell(tmp_path, shipped=shipped), "--runs", tmp_path / "runs", "--json", result)
    done = cellctl("run", procedure, "--seed", "1", *places, *settings(name))
    assert done.returncode == 0, done.stderr
    found = json.loads(result.read_text())
    assert found["verdict"] == "better"
    journal = fold(read_journal(tmp_path / "runs" / found["run"]))
    assert journal.ended is not None
    report = (tmp_path / "runs" / found["run"] / "report.html").read_text()
    assert ('id="sphere-convergence"' in report) == (name == "spherical_constraint")
    assert ('id="tracker-methods"' in report) == ("method" in FEW[name])
    assert "cannot be shown" not in report
    compared = journal.last(ComparedModelsRow)
    if name in PAPERS_MODEL:
        assert compared is not None
        assert [each.choice for each in compared.models][:2] == [PAPERS_MODEL[name], "auto"]
        assert "Models on the same poses" in report
    replayed = cellctl("replay", tmp_path / "runs" / found["run"])
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
    if "method" in FEW[name]:
        table = json.loads((tmp_path / "runs" / found["run"] / "table.json").read_text())
        assert table["source"]["method"] == FEW[name]["method"]
