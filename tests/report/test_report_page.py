"""The page: what a reader of it relies on."""

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from html_pages import Page

from cellctl.files import write_atomically
from cellctl.formats.model import REGION_MARGIN_DEG, JointRegion
from cellctl.journal import Journal, JournalError, fold, read_journal
from cellctl.records import TableStateRow
from cellctl.report import report_text, write_report


def standoff_rows(before, after, sigma=0.05, expected=0.0):
    rows = [{"number": n, "run": "before", "row": None, "error_mm": e} for n, e in enumerate(before, 1)]
    rows += [
        {"number": n, "run": "after", "row": n, "error_mm": e, "expected_mm": expected, "sigma_mm": sigma}
        for n, e in enumerate(after, 1)
    ]
    return [("standoff", row) for row in rows]


@pytest.fixture(scope="module")
def full_run(make_run_once, campaign):
    """A run with everything that the report has a place for."""
    reference = {"sphere": "S1", "repeats": 0, "sigma_mm": 0.02}
    rows = [
        *standoff_rows([1.2, -0.9, 2.0, -1.5], [0.03, -0.05, 0.06, -0.04]),
        *[("reference", {**reference, "after_touch": 20 * n, "shift_mm": -0.01 * n}) for n in range(1, 4)],
        (
            "table",
            {"id": "ab" * 32, "rows": 2, "pushed": True, "verified": True, "active": True, "max_correction_deg": 0.3},
        ),
    ]
    standoff = {
        "before": {"mean": 1.4, "rms": 1.458, "max": 2.0},
        "after": {"mean": 0.045, "rms": 0.0464, "max": 0.06},
        "n": 4,
        "predicted_sigma": 0.05,
    }
    drift = {"mm_per_touch": -0.0005, "significant": True, "modelled": True}
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


def test_the_figures_are_computed_anew_from_the_files_and_agree_with_the_journal(plain_html, campaign):
    text = Page(plain_html).text
    figures = campaign.verdict["model"]
    assert f"found {figures['test']['rms']:.3f} mm RMS" in text
    assert "differ from the journal" not in text


def test_a_data_set_that_was_changed_after_the_run_is_noticed(make_run, campaign):
    run = make_run(campaign)
    lines = (run / "dataset.csv").read_text().splitlines()
    held_out = next(number for number, line in enumerate(lines) if ",test," in line)
    cells = lines[held_out].split(",")
    lines[held_out] = ",".join([str(float(cells[0]) + 0.5), *cells[1:]])
    write_atomically(run / "dataset.csv", "\n".join(lines) + "\n")
    assert "differ from the journal" in Page(report_text(run)).text


def test_a_data_set_with_another_hash_than_the_model_was_made_from_is_named(make_run, campaign):
    model = campaign.model.model_copy(update={"provenance": {"data_sha256": "0" * 64}})
    assert "dataset.csv is not the file" in report_text(make_run(replace(campaign, model=model)))


def test_simulated_devices_are_said_in_big_letters_and_real_ones_are_not(plain_html, make_run, campaign):
    assert '<p class="simulated">SIMULATED</p>' in plain_html
    assert "SIMULATED" not in report_text(make_run(campaign, real=True))


def test_verdict_and_figures_stand_at_the_top_with_their_uncertainty(full_html, campaign):
    text = Page(full_html).text
    assert campaign.verdict["sentence"] in text
    assert text.index(campaign.verdict["sentence"]) < text.index("Held-out touches")
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


def test_what_the_model_foresaw_of_a_stand_off_error_is_not_held_against_its_sigma(make_run, campaign):
    rows = standoff_rows([1.0, 1.0], [0.5, 0.6], sigma=0.1, expected=0.5)
    rows[0][1]["expected_mm"], rows[1][1]["expected_mm"] = 1.03, 0.96
    text = Page(report_text(make_run(campaign, rows=rows))).text
    assert "found 0.071 mm RMS where 0.10 mm was predicted" in text
    assert "foresaw each error of the nominal robot to 0.035 mm RMS" in text


def test_held_out_touches_outside_the_region_of_the_fit_are_counted(make_run, campaign):
    turned = sorted(row["joints"][0] for row in campaign.touches if row["set"] == "test")
    all_but_the_last = (turned[-1] + turned[-2]) / 2 - REGION_MARGIN_DEG
    region = JointRegion(min=[-360.0] * 6, max=[all_but_the_last, *[360.0] * 5])
    model = campaign.model.model_copy(update={"joint_region": region})
    text = Page(report_text(make_run(replace(campaign, model=model)))).text
    assert "1 of them lies outside the joint region of the fit" in text


def test_reference_touches_drift_and_table_are_shown_where_they_are_recorded(full_html, plain_html):
    text = Page(full_html).text
    assert "3 visits to the same touch" in text
    assert "−0.0005" in text
    assert "drift, modelled" in text
    assert "max correction, ° 0.3" in text
    assert "ab" * 32 in text
    assert re.search(r"predicted error before, mm 2\.0 2\.5", text)
    without = Page(plain_html).text
    for heading in ("Reference touches", "Compensation table", "Stand-off proof"):
        assert heading in text
        assert heading not in without


def test_a_table_file_that_is_not_the_table_that_was_pushed_is_named(make_run, campaign):
    rows = [("table", TableStateRow("ab" * 32, 1, True, True, True, 0.1).data())]
    run = make_run(campaign, rows=rows, table={"id": "cd" * 32, "rows": []})
    assert "another id than the table that was pushed" in report_text(run)


@pytest.mark.long
def test_outliers_are_named_by_line_and_touch(make_run, spoilt_campaign):
    assert [row["line"] for row in spoilt_campaign.verdict["model"]["outliers"]] == [22]
    text = Page(report_text(make_run(spoilt_campaign))).text
    assert "they are listed below" in text
    assert re.search(r"22 20 outlier error .* mm, the others", text)


def test_each_parameter_has_its_deviation_tolerance_and_what_the_data_gave(plain_html):
    text = Page(plain_html).text
    found = re.search(r"a2 mm 600 ([−\d.]+) ± ([\d.]+)[ †]* 0\.50 (> )?(\d+) %", text)
    assert found
    assert abs(float(found[1].replace("−", "-")) - 0.6) < 4.0 * float(found[2])
    assert re.search(r"θ1 ° 0 \S+ ± 0\.050 0\.050 (< 1|0) %", text)


def test_what_cannot_be_seen_is_said_with_the_relative_sigma_beside_the_raw_one(plain_html):
    text = Page(plain_html).text
    raw = re.search(r"heading and height included ([\d.]+)", text)
    relative = re.search(r"the best rigid motion of all points together removed ([\d.]+)", text)
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
    cut_off = replace(campaign, model=None, verdict=None)
    text = Page(report_text(make_run(cut_off, ended=ended, reason="the probe is gone", failed="no line for 2 s"))).text
    assert words in text
    assert "64 measurements are recorded" in text
    assert "points[3].touch: no line for 2 s" in text
    assert "telegrams late 0, lost 1, skipped 0" in text
    assert "Identified parameters" not in text


def test_a_run_whose_process_died_is_called_cut_off(make_run, campaign):
    run = make_run(replace(campaign, model=None, verdict=None), ended=None)
    assert "This run was cut off while running" in Page(report_text(run)).text


def test_a_run_that_is_still_written_is_called_running(tmp_path):
    with Journal.create(tmp_path / "run", lambda: 0):
        assert "This run is still running" in Page(report_text(tmp_path / "run")).text


def test_a_damaged_model_or_table_is_named_and_the_rest_is_shown(make_run, campaign):
    run = make_run(campaign, rows=standoff_rows([1.0], [0.1]))
    (run / "model.json").write_text('{"format": "cellctl model 1"}')
    (run / "table.json").write_text("[1, 2")
    page = Page(report_text(run))
    assert "is no model file" in page.text
    assert "Stand-off proof" in page.text
    assert "Identified parameters" not in page.text


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
