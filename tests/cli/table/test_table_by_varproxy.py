"""`cellctl table` through the second channel: the shipped cell whose controller has a variable proxy alone."""

import json
from pathlib import Path

import pytest

from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv

CELL = Path(__file__).parents[3] / "procedures" / "cells" / "varproxy_cell.yaml"


@pytest.fixture
def table_command(cellctl, folder):
    """A table command on the cell, which keeps its memory between calls; exit code and its JSON."""

    def run(*words):
        code = cellctl("table", *words, "--cell", CELL, "--state", folder / "memory.json", "--json", "told.json")
        return code, json.loads((folder / "told.json").read_text())

    return run


@pytest.mark.long
def test_a_table_is_pushed_shown_verified_and_rolled_back(table_command, cellctl, folder):
    _, shown = table_command("show")
    assert shown["serial"].startswith("SIM-")
    assert shown["active"] is None
    kr5_model().save(folder / "model.json")
    (folder / "targets.csv").write_text(targets_csv(readings_near_the_middle(5)))
    assert cellctl("compensate", "model.json", "targets.csv", "--serial", shown["serial"], "-o", "table.json") == 0
    code, pushed = table_command("push", "table.json")
    assert code == 0
    assert (pushed["verified"], pushed["rows"]) == (True, 5)
    code, verified = table_command("verify", "table.json")
    assert code == 0
    assert verified["same"]
    _, rolled_back = table_command("rollback")
    assert rolled_back["active"] is None
    assert rolled_back["previous"]["id"] == pushed["id"]
    assert table_command("verify", "table.json")[0] == 1


def test_a_table_for_another_robot_is_refused_and_nothing_is_written(table_command, cellctl, folder):
    kr5_model().save(folder / "model.json")
    (folder / "targets.csv").write_text(targets_csv(readings_near_the_middle(5)))
    assert cellctl("compensate", "model.json", "targets.csv", "--serial", "SIM-000001", "-o", "table.json") == 0
    assert cellctl("table", "push", "table.json", "--cell", CELL, "--state", folder / "memory.json") == 2
    _, shown = table_command("show")
    assert shown["active"] is None
    assert shown["staged"] is None


def test_a_campaign_that_searches_is_refused_before_it_starts(cellctl, capsys):
    assert cellctl("check", "sphere_selfcal", "--cell", CELL) == 2
    assert "robot" in capsys.readouterr().err
