"""The page: what a reader of it relies on."""

import re
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from cellctl.files import canonical_json, write_atomically
from cellctl.formats.model import REGION_MARGIN_DEG, JointRegion
from cellctl.journal import Journal, JournalError, fold, read_journal
from cellctl.records import IdentificationRow, ResidualsRow, Row, TableStateRow
from cellctl.report import ReportSection, Run, Sections, Sigma, render, report_text, write_report
from cellctl.report.fit.page import fit_page
from cellctl.report.fit.residuals import Residuals
from tests.helpers.journals import SEARCH
from tests.helpers.reports import Page


def standoff_rows(before, after, sigma=0.05, expected=0.0):
    joints = dict.fromkeys(("resting", "nominal", "commanded", "at_target", "at_contact"), [0.0] * 6)
    each = {"sphere": "P1", "normal": [0.0, 0.0, 1.0], "travel_mm": 10.0, **joints, **SEARCH}
    rows = [
        {"number": n, "run": "before", "row": None, "error_mm": e, "expected_mm": 0.0, "sigma_mm": sigma}
        for n, e in enumerate(before, 1)
    ]
    rows += [
        {"number": n, "run": "after", "row": n, "error_mm": e, "expected_mm": expected, "sigma_mm": sigma}
        for n, e in enumerate(after, 1)
    ]
    return [("standoff", {**each, **row}) for row in rows]


@pytest.fixture(scope="module")
def full_run(make_run_once, campaign):
    """A run with everything that the report has a place for."""
    reference = {"sphere": "S1", "set": "reference", "repeats": 0, "sigma_mm": 0.02, **SEARCH}
    reference |= {"joints": [0.0] * 6, "resting": [0.0] * 6}
    rows = [
        *standoff_rows([1.2, -0.9, 2.0, -1.5], [0.03, -0.05, 0.06, -0.04]),
        *[
            ("reference", {**reference, "number": 20 * n, "after_touch": 20 * n, "shift_mm": -0.01 * n})
            for n in range(1, 4)
        ],
        (
            "table",
            {"id": "ab" * 32, "rows": 2, "pushed": True, "verified": True, "active": True, "max_correction_deg": 0.3},
        ),
    ]
    standoff = {
        "before": {"mean": 1.4, "rms": 1.458, "max": 2.0},
        "after": {"mean": 0.045, "rms": 0.0464, "max": 0.06},
        "n": 4,
        "sphere": "P1",
        "predicted_sigma": 0.05,
        "found_sigma": 0.0464,
    }
    drift = {
        "visits": 3,
        "mm_per_touch": -0.0005,
        "sigma_mm_per_touch": 0.0001,
        "t": -5.0,
        "significant": True,
        "total_mm": -0.03,
        "modelled": True,
    }
    row = {"target": [0] * 6, "predicted_before_mm": 1.5, "predicted_after_mm": 0.001, "sigma_mm": 0.06}
    table = {"id": "ab" * 32, "rows": [row, {**row, "predicted_before_mm": 2.5}]}
    return make_run_once(campaign, rows=rows, verdict={"standoff": standoff, "drift": drift}, table=table)


@pytest.fixture(scope="module")
def full_html(full_run):
    return report_text(full_run)


@pytest.fixture(scope="module")
def plain_html(make_run_once, campaign):
    """The report of a run with touches, model and verdict alone."""
    return report_text(make_run_once(campaign))


@pytest.mark.long
def test_the_page_is_one_whole_that_fetches_nothing_and_runs_nothing(full_html):
    text, page = full_html, Page(full_html)
    assert page.fetched == []
    assert not page.tags & {"script", "link", "img", "iframe", "object", "embed", "base"}
    assert "@import" not in text
    assert re.findall(r"url\((?!#)", text) == []
    assert len(page.ids) == len(set(page.ids))


def test_every_reference_inside_a_picture_finds_its_target(full_html):
    wanted = set(re.findall(r"(?:url\(#|href=\"#)([^)\"]+)", full_html))
    assert wanted
    assert wanted <= set(Page(full_html).ids)


@pytest.mark.long
def test_the_same_run_gives_the_same_bytes_in_another_process_too(full_run, full_html, tmp_path):
    assert write_report(full_run) == full_run / "report.html"
    here = (full_run / "report.html").read_bytes()
    assert here == full_html.encode()
    command = [sys.executable, "-m", "cellctl", "report", str(full_run), "-o", str(tmp_path / "there.html")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, env={"PYTHONHASHSEED": "7"}, check=True)
    assert done.stdout.strip() == str(tmp_path / "there.html")
    assert (tmp_path / "there.html").read_bytes() == here


def test_stored_residuals_are_those_of_the_verdict(campaign):
    rows = Residuals.of_row(campaign.rows[0])
    figures = campaign.verdict["model"]
    for signed, name in ((rows.signed_before, "nominal"), (rows.signed_after, "test")):
        errors = np.abs(signed[rows.held_out])
        assert errors.mean() == pytest.approx(figures[name]["mean"], abs=1e-8)
        assert errors.max() == pytest.approx(figures[name]["max"], abs=1e-8)
    assert rows.number.tolist() == [str(row["number"]) for row in campaign.touches]
    assert rows.point.tolist() == [row["sphere"] for row in campaign.touches]


def test_stored_rows_come_back_from_the_journal_as_they_were(make_run, campaign):
    state = fold(read_journal(make_run(campaign)))
    assert state.last(ResidualsRow) == campaign.rows[0]
    found = state.last(IdentificationRow)
    assert canonical_json(found.data()) == canonical_json(campaign.rows[1].data())


@pytest.mark.long
def test_the_identification_is_drawn_from_what_the_run_stored_alone(make_run, campaign, plain_html):
    run = make_run(campaign)
    (run / "dataset.csv").unlink()
    (run / "model.json").unlink()
    page, whole = report_text(run), plain_html
    first, last = '<section id="identification">', "Rows left out"
    assert first in page
    assert page.partition(first)[2].partition(last)[0] == whole.partition(first)[2].partition(last)[0]


@pytest.mark.long
def test_a_run_and_a_fit_show_the_same_identification(plain_html, campaign):
    """Every heading, picture and table of `fit --report` is in the run's report, letter for letter."""
    of_fit = fit_page(campaign.story).partition("<h2>Set-up")[2].partition("<h2>What each")[0]
    of_run = plain_html.partition("<h3>Set-up")[2].partition('<section id="')[0]
    assert (
        of_fit.replace("h2>", "h3>").split("</section>")[:-1]
        == of_run.split("</section>")[: of_fit.count("</section>")]
    )


def test_a_run_without_stored_residuals_says_so(make_run, campaign):
    text = Page(report_text(make_run(replace(campaign, rows=())))).text
    assert "This run stored no residuals" in text
    assert "Touches by sphere" not in text
    assert campaign.verdict["sentence"] in text


@pytest.mark.long
def test_a_data_set_that_was_changed_after_the_run_is_noticed(make_run, campaign):
    run = make_run(campaign)
    lines = (run / "dataset.csv").read_text().splitlines()
    held_out = next(number for number, line in enumerate(lines) if ",test," in line)
    cells = lines[held_out].split(",")
    lines[held_out] = ",".join([str(float(cells[0]) + 0.5), *cells[1:]])
    write_atomically(run / "dataset.csv", "\n".join(lines) + "\n")
    assert "dataset.csv is not the file that the model was made from" in Page(report_text(run)).text


@pytest.mark.long
def test_a_data_set_with_another_hash_than_the_model_was_made_from_is_named(make_run, campaign):
    model = campaign.model.model_copy(update={"provenance": {"data_sha256": "0" * 64}})
    assert "dataset.csv is not the file" in report_text(make_run(replace(campaign, model=model)))


@pytest.mark.long
def test_simulated_devices_are_named_in_big_letters_and_real_ones_are_not(plain_html, make_run, campaign):
    assert '<p class="simulated">SIMULATED</p>' in plain_html
    assert "SIMULATED" not in report_text(make_run(campaign, real=True))


def test_verdict_and_figures_stand_at_the_top_with_their_uncertainty(full_html, campaign):
    text = Page(full_html).text
    assert campaign.verdict["sentence"] in text
    assert text.index(campaign.verdict["sentence"]) < text.index("Touches by sphere")
    test = campaign.verdict["model"]["test"]
    count = campaign.verdict["model"]["n_test"]
    spread = np.sqrt((test["rms"] ** 2 - test["mean"] ** 2) / (count - 1))
    found = re.search(rf"held-out touches {count} \S+ ± \S+ \S+ \S+ ([\d.]+) ± ([\d.]+)", text)
    assert found
    assert float(found[1]) == pytest.approx(test["mean"], abs=spread)
    assert float(found[2]) == pytest.approx(spread, rel=0.05)


def test_the_stand_off_proof_compares_found_with_predicted(full_html):
    text = Page(full_html).text
    assert "4 targets with nominal joints, 4 with the controller's table" in text
    assert "found 0.046 mm RMS where 0.050 mm was predicted (ratio 0.93); 100 % lie within 2 σ" in text


@pytest.mark.long
def test_what_the_model_predicted_of_a_stand_off_error_is_not_held_against_its_sigma(make_run, campaign):
    rows = standoff_rows([1.0, 1.0], [0.5, 0.6], sigma=0.1, expected=0.5)
    rows[0][1]["expected_mm"], rows[1][1]["expected_mm"] = 1.03, 0.96
    text = Page(report_text(make_run(campaign, rows=rows))).text
    assert "found 0.071 mm RMS where 0.10 mm was predicted" in text
    assert "predicted each error of the nominal robot to 0.035 mm RMS" in text


@pytest.mark.long
def test_held_out_touches_outside_the_region_of_the_fit_are_counted(make_run, campaign):
    turned = sorted(row["joints"][0] for row in campaign.touches if row["set"] == "test")
    all_but_the_last = (turned[-1] + turned[-2]) / 2 - REGION_MARGIN_DEG
    region = JointRegion(min=[-360.0] * 6, max=[all_but_the_last, *[360.0] * 5])
    model = campaign.model.model_copy(update={"joint_region": region})
    text = Page(report_text(make_run(replace(campaign, model=model)))).text
    assert "1 held-out touch lies outside the measured joint region" in text


def test_reference_touches_drift_and_table_are_shown_where_they_are_recorded(full_html, plain_html):
    text = Page(full_html).text
    assert "3 visits to the same touch" in text
    assert "drift, mm per touch −0.00050 ± 0.00010" in text
    assert "drift, modelled" in text
    assert "largest correction of a joint, ° 0.3" in text
    assert "ab" * 32 in text
    assert re.search(r"predicted error before, mm 2\.0 2\.5", text)
    for heading in ("Reference touches", "Compensation table", "Proof by stand-offs"):
        assert f"<h2>{heading}</h2>" in full_html
        assert f"<h2>{heading}</h2>" not in plain_html


@pytest.mark.long
def test_a_table_file_that_is_not_the_table_that_was_pushed_is_named(make_run, campaign):
    rows = [("table", TableStateRow("ab" * 32, 1, True, True, True, 0.1).data())]
    run = make_run(campaign, rows=rows, table={"id": "cd" * 32, "rows": []})
    assert "another id than the table that was pushed" in report_text(run)


@pytest.mark.long
def test_outliers_are_named_by_line_and_touch(make_run, spoilt_campaign):
    assert [row["line"] for row in spoilt_campaign.verdict["model"]["outliers"]] == [22]
    text = Page(report_text(make_run(spoilt_campaign))).text
    assert "1 touch left out of the fit is not counted here" in text
    assert re.search(r"22 20 left out .* mm, the others", text)


def test_each_parameter_has_its_deviation_tolerance_and_what_the_data_gave(plain_html):
    text = Page(plain_html).text
    found = re.search(r"a2 mm 600 ([−\d.]+) ± ([\d.]+)[ †]* 0\.50 \S+ \S+ (> )?(\d+) %", text)
    assert found
    assert abs(float(found[1].replace("−", "-")) - 0.6) < 4.0 * float(found[2])
    assert re.search(r"θ1 ° 0 \S+ ± 0\.050 0\.050 \S+ \S+ (< 1|0) %", text)


def test_what_cannot_be_seen_is_said_with_the_relative_sigma_beside_the_raw_one(plain_html):
    text = Page(plain_html).text
    raw = re.search(r"with the place of the robot ([\d.]+)", text)
    relative = re.search(r"without what moves all of them as one body ([\d.]+)", text)
    assert raw
    assert relative
    assert float(relative[1]) < float(raw[1]) / 2
    assert re.search(r"θ1(, d1 each)? with centres of", text)


@pytest.mark.parametrize(
    ("ended", "words"),
    [
        ("failed", "This run failed: the probe is gone"),
        ("aborted", "This run was aborted: the probe is gone"),
        ("uncertain", "This run ended uncertain: a person has to look at the cell: the probe is gone"),
    ],
)
def test_a_run_that_did_not_finish_says_so_first_and_shows_what_there_is(make_run, campaign, ended, words):
    cut_off = replace(campaign, model=None, verdict=None, rows=())
    text = Page(report_text(make_run(cut_off, ended=ended, reason="the probe is gone", failed="no line for 2 s"))).text
    assert words in text
    assert "64 measurements are recorded" in text
    assert "points[3].touch: no line for 2 s" in text
    assert "telegrams late 0, lost 1, skipped 0" in text
    assert "Identification" not in text


def test_a_run_whose_process_died_is_called_cut_off(make_run, campaign):
    run = make_run(replace(campaign, model=None, verdict=None, rows=()), ended=None)
    assert "This run was cut off while running" in Page(report_text(run)).text


def test_a_run_that_is_still_written_is_called_running(tmp_path):
    with Journal.create(tmp_path / "run", lambda: 0):
        assert "This run is still running" in Page(report_text(tmp_path / "run")).text


@pytest.mark.long
def test_a_damaged_model_or_table_is_named_and_the_rest_is_shown(make_run, campaign):
    run = make_run(campaign, rows=standoff_rows([1.0], [0.1]))
    (run / "model.json").write_text('{"format": "cellctl model 1"}')
    (run / "table.json").write_text("[1, 2")
    page = Page(report_text(run))
    assert "is no model file" in page.text
    assert "Proof by stand-offs" in page.text
    assert "Identified parameters" in page.text


def test_names_from_files_cannot_break_the_page(plain_html):
    assert "Touches &amp; &lt;b&gt;proof&lt;/b&gt;" in plain_html
    assert "<b>proof" not in plain_html


def test_provenance_names_hashes_versions_operator_devices_seed_and_clock(full_run, full_html):
    text = Page(full_html).text
    started = fold(read_journal(full_run)).started
    for word in (started.procedure.sha256, started.cell.sha256, "c0de" * 16, "somebody", "SIM-1", "lockstep", "3.11.7"):
        assert word in text


@pytest.mark.long
def test_no_journal_no_report(tmp_path):
    with pytest.raises(JournalError):
        write_report(tmp_path)
    assert list(tmp_path.iterdir()) == []
    command = [sys.executable, "-m", "cellctl", "report", "nowhere", "--runs", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 2
    assert "there is no journal" in done.stderr


@dataclass(frozen=True)
class WarmUpRow(Row):
    """A row of a campaign that cellctl does not know."""

    KIND: ClassVar[str] = "warm_up"
    minutes: float


def section_of_another_package(**settings):
    return ReportSection(
        **{
            "id": "warm-up",
            "title": "Warm-up",
            "order": 5,
            "needs": (WarmUpRow,),
            "build": lambda run: {"minutes": run.state.last(WarmUpRow).minutes},
            "template": "<p>{{ minutes }} minutes</p>",
            "sigmas": (Sigma("σ of a minute", "the clock", "guessed", "1 σ"),),
            **settings,
        }
    )


class TestSections:
    """Sections are chosen by the rows of a run, and found by entry points."""

    def test_a_section_of_another_package_is_shown_where_its_row_is_recorded(self, make_run):
        sections = Sections.of([*Sections.installed().usable, section_of_another_package()])
        with_row = Page(render(Run.load(make_run(rows=[("warm_up", {"minutes": 30.0})])), sections)).text
        assert re.search("Warm-up 30.0 minutes.*Provenance.*σ of a minute the clock guessed 1 σ", with_row)
        assert "Warm-up" not in Page(render(Run.load(make_run()), sections)).text

    @pytest.mark.parametrize(
        "broken", [{"build": lambda run: 1 / 0}, {"template": "{{ absent }}"}, {"error_lines": lambda run: 1 / 0}]
    )
    def test_a_section_that_fails_is_named_and_the_others_are_shown(self, make_run, broken):
        sections = Sections.of([*Sections.installed().usable, section_of_another_package(**broken)])
        text = Page(render(Run.load(make_run(rows=[("warm_up", {"minutes": 30.0})])), sections)).text
        assert "section 'warm-up' cannot be shown" in text
        assert "Provenance" in text

    def test_a_damaged_row_is_named_and_the_other_sections_are_shown(self, make_run):
        text = Page(report_text(make_run(rows=[("standoff", {"number": 1})]))).text
        assert "section 'sphere-standoffs'" in text
        assert "Provenance" in text

    def test_no_section_of_another_campaign_complains_about_a_run(self, full_html):
        assert "section '" not in Page(full_html).text

    def test_the_installed_sections_are_those_of_cellctl_and_of_the_sphere_campaign(self):
        found = Sections.installed()
        assert not found.broken
        assert {"verdict", "identification", "table", "provenance", "sphere-standoffs"} <= {s.id for s in found.usable}


def test_every_sigma_of_the_page_is_explained_with_its_level(full_html, plain_html):
    text = Page(full_html).text.partition("What each σ means")[2]
    for name in (
        "mean ± u",
        "assumed σ",
        "deviation ± σ",
        "1 σ of the TCP",
        "95 % region",
        "predicted σ of a stand-off",
    ):
        assert name in text
    assert "predicted σ of a stand-off" not in Page(plain_html).text
    assert "tolerance" not in Page(full_html).text


def test_instrument_operator_date_serial_and_temperature_are_on_the_page(plain_html, make_run):
    text = Page(plain_html).text
    for words in ("date 2026-11-21T20:30:02Z", "operator somebody", "serial SIM-1, simulated"):
        assert words in text
    assert "air temperature not recorded" in text


def test_no_raw_key_is_on_the_page(full_html):
    found = set(re.findall(r"\b[a-z]{2,}(?:_[a-z0-9]+)+\b", Page(full_html).text))
    assert not found


def test_pages_are_numbered_in_print(plain_html):
    assert "counter(page)" in plain_html
