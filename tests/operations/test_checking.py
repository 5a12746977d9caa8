"""What a form for a run shows: procedures and cells to choose, parameters with limits, errors at their line."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from cellctl.operations.checking import check, choices, first_choice, form_of, line_of, missing_devices, setting_problem
from cellctl.procedure import load_procedure

OWN = """procedure: mine
title: My own check
cell: cells/my_cell.yaml
parameters:
  touches: {type: integer, default: 20, min: 18, max: 200, unit: touches, help: how many}
steps:
  - {id: clear, confirm: "Is the cell clear?"}
  - {id: plan, do: sphere.pla, with: {fit: "${touches}"}}
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "procedures").mkdir()
    (tmp_path / "procedures" / "mine.yaml").write_text(OWN)
    (tmp_path / "notes.yaml").write_text("title: no procedure")
    (tmp_path / "my_cell.yaml").write_text("name: my cell\nmodel: ur10\ndevices: {robot: kuka+rsi://a}\n")
    monkeypatch.chdir(tmp_path)
    return Path("procedures/mine.yaml")


def test_own_files_below_the_working_folder_are_offered_beside_the_shipped_ones(own: Path) -> None:
    procedures, cells = choices("procedure"), choices("cell")
    assert (procedures["mine"].file, procedures["mine"].title, procedures["mine"].shipped) == (
        own,
        "My own check",
        False,
    )
    assert procedures["mine"].cell == "my_cell"
    assert procedures["sphere_selfcal"].shipped
    assert "notes" not in procedures.keys() | cells.keys()
    assert (cells["my_cell"].simulated, cells["sphere_cell"].simulated) == (False, True)


@pytest.mark.parametrize(
    ("cell", "procedure"), [("my_cell", "mine"), ("sphere_cell", "sphere_selfcal"), ("", "sphere_selfcal")]
)
def test_the_procedure_offered_first_fits_the_cell(own: Path, cell: str, procedure: str) -> None:
    assert first_choice(choices("procedure"), cell).name == procedure


def test_the_form_has_each_parameter_with_limits_and_unit_and_what_an_operator_confirms(own: Path) -> None:
    form = form_of(own)
    touches = form.parameters["touches"]
    assert (touches.default, touches.min, touches.max, touches.unit) == (20, 18, 200, "touches")
    assert form.confirms == ("Is the cell clear?",)
    assert form.lines[0] == "procedure: mine"


@pytest.mark.parametrize(
    ("text", "what"), [("17", "is out of its range"), ("many", "takes a whole number"), ("18", "")]
)
def test_a_value_is_judged_by_type_and_limits_before_the_whole_check(own: Path, text: str, what: str) -> None:
    found = setting_problem(load_procedure(own), "touches", text)
    assert what in found.what if found and what else found is None


def test_the_check_gives_each_error_with_its_line_and_the_settings_too(own: Path) -> None:
    found = asyncio.run(check(own, None, ["touches=5"]))
    places = {(problem.file, problem.line): problem for problem in found.problems}
    assert "there is no step 'sphere.pla'" in places[str(own), 8].what
    assert "plan" in line_of(places[str(own), 8])
    assert "is out of its range" in places["--set touches=5", 0].what
    assert any("my_cell.yaml" in file for file, _ in places)


def test_a_cell_without_a_device_of_the_procedure_is_known_before_the_check() -> None:
    procedures = Path(__file__).parents[2] / "procedures"
    daily = procedures / "daily_check.yaml"
    lacked = missing_devices(daily, procedures / "cells" / "sphere_cell.yaml")
    assert "a device 'tracker', and the cell has none" in lacked
    assert missing_devices(daily, procedures / "cells" / "tracker_cell.yaml") == ()
