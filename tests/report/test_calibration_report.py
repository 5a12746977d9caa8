"""The first two pages: parties, instruments, environment, acceptance by a stated rule, and an uncertainty budget."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.exit_codes import Exit
from cellctl.cli.verbs import app
from cellctl.records import Figures
from cellctl.report import Contribution, Run, render, report_text
from cellctl.report.acceptance import acceptance
from cellctl.report.budget import Budget, scatter_of_fit
from tests.helpers.reports import Page

NOISE_MM = 0.01
"""Of the touches of `campaign`, along the normal."""

FACTS = """
report:
  customer: ACME & Sons
  order: "0815"
  limit_mm: 0.2
  calibrated:
    robot: {date: 2026-03-01}
    artefact: {date: 2026-01-15, certificate: C-1203, serial: B-17}
  sigma_mm: {artefact: 0.002, spindle: 0.05}
"""
CHROMIUM = shutil.which("chromium")


@pytest.fixture(scope="module")
def stated(make_run_once, campaign):
    return make_run_once(campaign, cell=FACTS)


@pytest.fixture(scope="module")
def stated_text(stated):
    return report_text(stated)


def summary(text):
    """The text of the first pages, after the verdict."""
    return Page(text.partition('<section id="summary">')[2].partition("</section>")[0]).text


def budget_of(text):
    """The numbers of each line of the budget: of a measured error, of a position."""
    table = text.partition('budget">')[2].partition("</table>")[0]
    rows = re.findall(
        r"<tr[^>]*><th[^>]*>(.*?)</th>.*?<td class=\"number\">(.*?)</td><td class=\"number\">(.*?)</td>", table
    )
    return {name: (error, position) for name, error, position in rows}


@pytest.mark.long
def test_the_page_is_called_a_calibration_report_and_not_a_certificate(stated_text):
    text = stated_text
    assert "<h1>Calibration report</h1>" in text
    assert "This is a calibration report, not a certificate." in summary(text)


def test_what_the_cell_file_states_is_on_the_page(stated_text):
    text = summary(stated_text)
    for words in ("customer ACME & Sons", "order 0815", "site not stated", "operator somebody", "serial SIM-1"):
        assert words in text
    assert "artefact 3 spheres, diameter 61.4 mm B-17 2026-01-15 C-1203" in text


@pytest.mark.long
def test_what_a_run_does_not_have_is_not_stated_or_not_recorded(make_run, campaign):
    text = summary(report_text(make_run(campaign)))
    for words in ("customer not stated", "limit of the greatest error not stated", "air pressure not recorded"):
        assert words in text
    assert "artefact 3 spheres, diameter 61.4 mm not stated not stated not stated" in text
    assert "No decision. No acceptance limit is stated." in text
    assert "Not stated, so not contained: spheres and tip: diameter, form; temperature" in text


def test_a_run_that_identified_nothing_has_no_budget_and_no_decision(make_run):
    run = Run.load(make_run(ended="aborted")).with_facts({"limit_mm": 0.2})
    text = summary(render(run))
    assert "Uncertainty not stated: this run identified no model." in text
    assert "No decision. The run has no measured error after calibration." in text


def test_scatter_of_the_fit_is_the_noise_of_the_measurements(campaign):
    figures = campaign.verdict["model"]
    found, free = scatter_of_fit("sphere", figures["fit"]["rms"], figures["n_fit"], figures["rank"])
    assert free == figures["n_fit"] - figures["rank"]
    assert found == pytest.approx(NOISE_MM, rel=3.0 / np.sqrt(2.0 * free))


def test_scatter_of_a_fit_without_degrees_of_freedom_is_not_stated():
    assert scatter_of_fit("sphere", 0.001, 31, 31) is None


def test_the_budget_adds_squares_and_a_line_counts_root_three_in_space():
    parts = [
        Contribution.of_errors("certificate", "B", "", 0.004, 1),
        Contribution.of_errors("scatter", "A", "", 0.003, 1),
        Contribution("identified", "A", "", position_mm=0.02),
        Contribution("temperature", "B", ""),
    ]
    budget = Budget.of(parts, 1)
    assert budget.error_mm == pytest.approx(0.005)
    assert budget.position_mm == pytest.approx(np.sqrt(3 * 0.005**2 + 0.02**2))
    assert budget.expanded_mm == pytest.approx((1.96 * 0.005, 1.61 * budget.position_mm))
    assert Budget.of(parts, 1, 2.02).expanded_mm == pytest.approx((1.96 * 0.005, 2.02 * budget.position_mm))
    assert [each.kind for each in budget.contributions] == ["A", "A", "B", "B"]
    assert list(budget.missing) == ["temperature"]


@pytest.mark.parametrize("dimensions", [1, 3])
def test_the_coverage_factor_covers_95_percent_of_normal_errors(dimensions):
    errors = np.random.default_rng(3).normal(0.0, 0.1, (200_000, dimensions))
    rms = 0.1 * np.sqrt(dimensions)
    budget = Budget.of([Contribution.of_errors("scatter", "A", "", rms, dimensions)], dimensions)
    assert (np.linalg.norm(errors, axis=1) <= budget.expanded_mm[0]).mean() == pytest.approx(0.95, abs=0.003)


def test_the_page_shows_the_budget_with_stated_uncertainties(stated_text):
    lines = budget_of(stated_text)
    assert lines["certified distances"] == ("in the fit", "in the fit")
    assert lines["spheres and tip: diameter, form"] == ("0.0020", "0.0035")
    assert lines["spindle"] == ("0.050", "0.087")
    assert lines["identified parameters"][0] == "–"
    parts = [float(error) for name, (error, _) in lines.items() if error[0].isdigit() and "uncertainty" not in name]
    parts.remove(1.96)
    assert float(lines["combined standard uncertainty"][0]) == pytest.approx(np.hypot.reduce(parts), rel=0.03)
    assert lines["coverage factor, 95 %"] == ("1.96", "1.61")


@pytest.mark.parametrize(
    ("greatest", "word"),
    [(0.100, "accepted"), (0.11, "no decision"), (0.29, "no decision"), (0.31, "rejected")],
)
def test_the_guard_band_of_the_decision_is_the_expanded_uncertainty(stated, greatest, word):
    loaded = Run.load(stated).with_facts({"limit_mm": 0.2})
    object.__setattr__(loaded.verdict, "after", Figures(0.05, 0.06, greatest))
    budget = Budget.of([Contribution.of_errors("scatter", "A", "", 0.1 / 1.96, 1)], 1)
    assert acceptance(loaded, budget, []).word == word


@pytest.mark.long
def test_a_run_that_did_not_finish_is_not_accepted(make_run, campaign):
    run = Run.load(make_run(campaign, ended="failed", reason="probe: lost")).with_facts({"limit_mm": 99.0})
    assert "No decision. The run has no measured error after calibration." in summary(render(run))


@pytest.mark.long
def test_options_of_the_command_replace_what_the_cell_file_states(stated, tmp_path):
    out = tmp_path / "report.html"
    words = ["report", str(stated), "-o", str(out), "--customer", "Beta", "--limit", "9.5", "--operator", "Kai"]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == Exit.GOOD
    text = summary(out.read_text())
    for words in ("customer Beta", "order 0815", "operator Kai", "limit of the greatest error 9.5 mm", "Accepted."):
        assert words in text


def test_a_limit_that_is_no_length_is_refused(stated, tmp_path):
    words = ["report", str(stated), "-o", str(tmp_path / "x.html"), "--limit", "-1"]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == Exit.BAD_INPUT


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_the_part_for_a_manager_prints_on_two_pages(stated_text, tmp_path):
    first = stated_text.partition('<div class="details">')[0] + "</body></html>"
    (tmp_path / "first.html").write_text(first)
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer"]
    command += [f"--user-data-dir={tmp_path}/profile", f"--print-to-pdf={tmp_path}/first.pdf", f"{tmp_path}/first.html"]
    subprocess.run(command, check=True, timeout=300, capture_output=True)
    assert len(re.findall(rb"/Type /Page\b(?!s)", (tmp_path / "first.pdf").read_bytes())) in (1, 2)
