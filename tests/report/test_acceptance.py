"""The acceptance of a run by the criteria of its cell file: in the report, in the run's figures, in its folder."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.exit_codes import Exit
from cellctl.cli.verbs import app
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError
from cellctl.journal import Journal, RunResumed, fold, read_journal
from cellctl.operations.run_list import run_row
from cellctl.report import assessed_run, write_report
from cellctl.report.figures import acceptance_words

CRITERIA = """
report:
  sigma_mm: {artefact: 0.003}
acceptance:
  - {limit_mm: 5, procedure: another}
  - {limit_mm: 5, robot: "77"}
  - {limit_mm: 0.05, measurand: mean, procedure: campaign, robot: SIM-1}
  - {limit_mm: 5}
"""


@pytest.fixture(scope="module")
def stated(make_run_once, campaign):
    return make_run_once(campaign, cell=CRITERIA)


def test_the_first_criterion_for_procedure_and_robot_decides_by_the_runs_own_errors(stated, campaign):
    assessed = assessed_run(stated)
    run, found = assessed.run, assessed.acceptance
    errors = np.array(run.state.data_of("identification")[-1]["after"])
    assert (found.measurand, found.limit_mm, found.word) == ("mean", 0.05, "accepted")
    assert found.figure.n == len(errors) == 16
    assert found.value_mm == pytest.approx(campaign.verdict["after"]["mean"])
    assert found.figure.standard_mm == pytest.approx(np.hypot(errors.std(ddof=1) / 4.0, 0.003))
    assert assessed.budget.shared_mm == pytest.approx(0.003)
    assert found.missing == ("temperature: expansion of robot and set-up",)


def test_a_limit_by_option_replaces_the_limit_and_keeps_the_measurand(stated):
    found = assessed_run(stated, {"limit_mm": 0.001}).acceptance
    assert (found.measurand, found.limit_mm, found.word) == ("mean", 0.001, "rejected")


@pytest.mark.parametrize(("measurand", "reason"), [("quantile_95", "needs 20 "), ("maximum", "plus 2 U")])
def test_other_measurands_and_guard_bands(make_run, campaign, measurand, reason):
    cell = f"acceptance: [{{limit_mm: 0.5, measurand: {measurand}, guard: 2}}]\n"
    found = assessed_run(make_run(campaign, cell=cell)).acceptance
    assert reason in found.reason
    assert found.word == ("no decision" if measurand == "quantile_95" else "accepted")


@pytest.fixture(scope="module")
def written(stated):
    """With its report."""
    write_report(stated)
    return stated


@pytest.mark.long
def test_the_decision_goes_with_the_report_and_lists_and_show_have_it(written, capsys):
    stated = written
    row = run_row(stated)
    assert row.accepted == "accepted"
    content = json.loads((stated / "acceptance.json").read_text())
    assert {key: content[key] for key in row.acceptance} == dict(row.acceptance)
    assert exit_codes.exit_code_of(lambda: app(["show", str(stated)], standalone_mode=False)) == Exit.GOOD
    printed = capsys.readouterr().out
    assert f"acceptance {acceptance_words(row.acceptance)}" in printed
    assert "accepted: mean 0.0" in printed
    exit_codes.exit_code_of(lambda: app(["runs", "--runs", str(stated.parent)], standalone_mode=False))
    assert "accepted" in capsys.readouterr().out


@pytest.mark.long
def test_a_decision_from_before_a_run_went_on_is_not_shown(written, tmp_path):
    place = Path(shutil.copytree(written, tmp_path / "run-1"))
    assert run_row(place).accepted == "accepted"
    with Journal.reopen(place, lambda: 10**12) as journal:
        journal.append(RunResumed("somebody", "2026-11-22T08:00:00Z", "", {}))
    assert run_row(place).acceptance is None
    assert fold(read_journal(place)).resumed == 1


@pytest.mark.parametrize("text", ["[1, 2", "[1, 2]", "{}"])
def test_a_damaged_decision_is_none(stated, text):
    (stated / "acceptance.json").write_text(text)
    assert run_row(stated).acceptance is None


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("acceptance: [{limit_mm: -1}]", "limit_mm"),
        ("acceptance: [{limit_mm: 1, measurand: median}]", "measurand"),
        ("acceptance: [{limit_mm: 1}]\nreport: {limit_mm: 2}", "states the limit already"),
    ],
)
def test_a_criterion_that_says_nothing_or_twice_is_an_error_of_the_cell_file(tmp_path, text, what):
    cell = tmp_path / "cell.yaml"
    cell.write_text(f"name: c\nmodel: kr5_r1400\ndevices: {{probe: 'contact+serial:///dev/ttyACM0'}}\n{text}\n")
    with pytest.raises(InputError, match=what):
        Cell.load(cell, DriverRegistry())
