"""Sections that show a paper's figures from a run's rows, and the steps that record these rows."""

import asyncio
import re
from dataclasses import replace

import numpy as np
import pytest

from cellctl.files import parse_yaml
from cellctl.formats.table_making import compensated_targets, nominal_chain, table_of
from cellctl.records import BatchRow, ComputingTimesRow, Row
from cellctl.report import Run, report_text
from procedures.reports.tracker.methods import Workspace
from procedures.steps.sphere.converging import convergence
from procedures.steps.sphere.rows import ConvergenceRow
from procedures.steps.sphere.touching import IdentifyInputs
from procedures.steps.tracker.comparing_methods import CompareMethodsInputs, compare_methods
from procedures.steps.tracker.rows import ComparedMethodsRow
from tests.helpers.reports import Page
from tests.helpers.steps import Context
from tests.report.conftest import CELL, ROBOT

METHODS = ("pseudo-target", "pseudo-target-matrix", "veitschegger-wu", "newton-raphson")


@pytest.fixture(scope="module")
def converged(campaign, tmp_path_factory) -> ConvergenceRow:
    """What the step records of the touches."""
    folder = tmp_path_factory.mktemp("converged")
    campaign.data.write(folder / "dataset.csv")
    context = Context(run_folder=folder, robot_file=ROBOT, cell=parse_yaml(CELL, "cell.yaml"))
    asyncio.run(convergence(context, IdentifyInputs()))
    [row] = context.recorded(ConvergenceRow)
    return row


@pytest.fixture(scope="module")
def compared(campaign, tmp_path_factory) -> list[Row]:
    """What the step records of targets at the touches."""
    folder, model = tmp_path_factory.mktemp("compared"), campaign.model
    readings = np.array([row["joints"] for row in campaign.touches[:8]])
    targets = nominal_chain(model).forward(model.robot.joint_map().model(readings))
    found = compensated_targets(model, targets, readings)
    model.save(folder / "model.json")
    table = table_of(model, targets, found, serial="1", simulated=True, run=None, created="2026-11-21T20:30:02Z")
    (folder / "table.json").write_text(table.text())
    context = Context(run_folder=folder)
    asyncio.run(compare_methods(context, CompareMethodsInputs(methods=METHODS, table=table.id)))
    return context.rows


def test_convergence_begins_at_the_nominal_robot_and_ends_at_the_identified_one(converged, campaign):
    ends = [campaign.verdict[name]["mean"] for name in ("before", "after")]
    assert [converged.held_out_mean[0], converged.held_out_mean[-1]] == pytest.approx(ends, rel=1e-6)
    assert converged.fit_mean[-1] < 0.1 * converged.fit_mean[0]


@pytest.mark.long
def test_the_section_of_one_sphere_has_our_figures_beside_the_published_ones(make_run, campaign, converged):
    text = report_text(make_run(campaign, rows=[(converged.KIND, converged.data())]))
    section = Page(text.partition('<section id="sphere-convergence">')[2].partition("</section>")[0]).text
    mean = [f"{campaign.verdict[name]['mean']:.3f}" for name in ("before", "after")]
    assert all(value in section for value in mean)
    assert all(value in section for value in ("1.923", "0.383", "4.715", "1.153", "3.657", "0.665", "5.559", "1.104"))
    assert f"{len(converged.fit_mean) - 1} iterations" in section


@pytest.mark.long
def test_without_its_row_a_run_has_no_such_section(make_run, campaign):
    assert 'id="sphere-convergence"' not in report_text(make_run(campaign))


@pytest.mark.long
def test_the_section_of_batches_has_the_curve_and_what_became_of_the_goal(make_run, campaign):
    one = BatchRow(
        noun="touches",
        rows=35,
        most=150,
        goal_mm=0.1,
        low_mm=0.081,
        median_mm=0.132,
        high_mm=0.213,
        next_mm=0.154,
        to_goal=22,
        seconds=480.0,
        model="geometry",
    )
    last = replace(one, rows=55, low_mm=0.031, median_mm=0.052, high_mm=0.093, next_mm=None, to_goal=None, ended="goal")
    text = report_text(make_run(campaign, rows=[(row.KIND, row.data()) for row in (one, last)]))
    section = text.partition('<section id="batches">')[2].partition("</section>")[0]
    assert "<svg" in section
    page = Page(section).text
    assert "55 touches: volumetric error 0.052 mm in the median, below 0.093 mm with 95 % (goal 0.1)" in page
    assert all(value in page for value in ("0.081", "0.132", "0.213", "0.154", "22", "8.0"))
    assert 'id="batches"' not in report_text(make_run(campaign))


def test_one_pass_of_each_method_leaves_micrometres_and_takes_a_time(compared):
    found, times = compared
    assert isinstance(found, ComparedMethodsRow)
    assert isinstance(times, ComputingTimesRow)
    assert [each.method for each in found.methods] == list(METHODS)
    assert all(max(each.error_mm) < 0.02 * max(found.before_mm) for each in found.methods)
    assert all(each.converged == len(found.before_mm) for each in found.methods)
    assert times.what == METHODS
    assert min(times.seconds) > 0.0


def test_without_a_table_no_method_is_compared():
    context = Context()
    asyncio.run(compare_methods(context, CompareMethodsInputs(methods=METHODS, table=None)))
    assert context.rows == []


def test_a_method_that_does_not_exist_is_refused_with_the_known_one():
    with pytest.raises(ValueError, match="newton-raphson"):
        CompareMethodsInputs(methods=("newton-rapson",), table=None)


@pytest.mark.long
def test_the_section_of_methods_has_the_times_of_the_journal_and_the_published_means(make_run, campaign, compared):
    times = ComputingTimesRow(what=METHODS, seconds=(8e-4, 16e-4, 24e-4, 32e-4), repeats=15)
    rows = [(row.KIND, row.data()) for row in (compared[0], times)]
    folder = make_run(campaign, rows=rows)
    text = report_text(folder)
    assert text == report_text(folder)
    section = text.partition('<section id="tracker-methods">')[2].partition("</section>")[0]
    lines = {
        name: re.findall(r"<td>([^<]*)</td>", rest)
        for name, rest in re.findall(r"<tr><th>(\S+) \(\d\)</th>(.*?)</tr>", section, re.DOTALL)
    }
    assert [cells[5] for cells in lines.values()] == ["100", "200", "300", "400"]
    assert [cells[6] for cells in lines.values()] == ["0.0539", "0.0533", "0.0584", "0.0533"]
    assert "<th>measured</th>" not in section, "no target of this run was measured again"


def test_the_limits_of_the_workspace_are_those_of_the_stretched_arm(campaign, make_run):
    model = Run.load(make_run(campaign)).model
    workspace = Workspace.of(model)
    assert 0.0 < workspace.apart < 10.0
    axis = np.array([[0.0, 0.0, 600.0], [5000.0, 0.0, 600.0]])
    inside = workspace.inside(axis)
    assert inside[0] > 500.0
    assert inside[1] < -1000.0
