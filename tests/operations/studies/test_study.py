"""A study: its file is checked as a whole, its rows are computed once, its folder belongs to one version of it."""

from __future__ import annotations

import json

import pytest
from pyarrow import parquet

from cellctl.calibration.identification.progress import silent
from cellctl.files import InputError
from cellctl.operations.studies import cluster, row_table
from cellctl.operations.studies.cluster import on_cluster
from cellctl.operations.studies.runner import in_processes, load
from cellctl.operations.studies.study import ROWS, by_same_code, run_study
from cellctl.operations.studies.study_file import Study
from tests.helpers.runs import CELL, cellctl, touches_procedure

FITS = """\
study: fit
name: fits
settings: {robot: ur10, folds: 0}
factors:
  rows: [20, 30]
  noise_mm: [0.03, 0.3]
seeds: {count: 2}
"""


def study_of(folder, text=FITS):
    (folder / "study.yaml").write_text(text)
    return Study.load(folder / "study.yaml")


def here(work, units):
    """Computes in this process: the last unit first."""
    return ((unit, work(unit)) for unit in reversed(units))


def nothing(work, units):
    raise AssertionError("a row that is there is computed again")


def test_units_are_the_product_of_the_factors_at_each_point_for_each_seed(tmp_path):
    text = FITS.replace("seeds:", "points: [{model: geometry, spread: 1}, {model: zeros, spread: 0.5}]\nseeds:")
    units = study_of(tmp_path, text).units
    assert [(u["model"], u["spread"], u["rows"], u["noise_mm"], u["seed"]) for u in units] == [
        (model, spread, rows, noise, seed)
        for model, spread in (("geometry", 1), ("zeros", 0.5))
        for rows in (20, 30)
        for noise in (0.03, 0.3)
        for seed in (1, 2)
    ]


@pytest.mark.parametrize(
    ("wrong", "right", "said"),
    [
        ("noise_mm: [0.03", "noise: [0.03", r"study.yaml:6:3: 'noise' is no setting"),
        ("rows: [20, 30]", "rows: [20, 20]", r"study.yaml:5:\d+: has a value twice"),
        ("robot: ur10, ", "", r"robot is not stated"),
        ("robot: ur10", "robot: ur11", r"ur11"),
        ("rows: [20, 30]", "rows: [20, two]", r"'two' cannot be used"),
        ("{count: 2}", "{count: 0}", r"study.yaml:7:\d+"),
        ("study: fit", "study: fits", r"study.yaml:1:\d+"),
    ],
)
def test_a_study_file_with_an_error_is_refused(tmp_path, wrong, right, said):
    assert wrong in FITS
    with pytest.raises(InputError, match=said):
        study_of(tmp_path, FITS.replace(wrong, right))


@pytest.mark.long
def test_rows_are_in_order_and_computed_once_and_another_study_or_code_is_refused(tmp_path, monkeypatch):
    study, folder = study_of(tmp_path), tmp_path / "studies" / "fits"
    first = run_study(study, tmp_path / "studies", here, silent)
    assert (first.before, first.now) == (0, 8)
    rows = parquet.read_table(folder / "rows.parquet").to_pylist()
    assert [{name: row[name] for name in unit} for row, unit in zip(rows, study.units, strict=True)] == [*study.units]
    assert all(0.0 < row["error_rms_mm"] < row["nominal_rms_mm"] for row in rows if row["noise_mm"] == 0.03)
    page = (folder / "report.html").read_text()
    assert page.count("<svg") == 2
    assert all(text in page for text in ("8 of 8", "error_rms_mm", "noise_mm", "geometry"))
    made = (folder / "rows.parquet").read_bytes()

    assert run_study(study, tmp_path / "studies", nothing, silent).before == 8
    lines = (folder / ROWS).read_text().splitlines(keepends=True)
    (folder / ROWS).write_text("".join(lines[:5]) + lines[5][:40])
    again = run_study(study, tmp_path / "studies", here, silent)
    assert (again.before, again.now, len(load(folder / ROWS))) == (5, 3, 8)
    assert (folder / "rows.parquet").read_bytes() == made

    changed = study_of(tmp_path, FITS.replace("0.3]", "0.4]"))
    with pytest.raises(InputError, match="the study file has changed"):
        run_study(changed, tmp_path / "studies", nothing, silent)
    monkeypatch.setattr("cellctl.operations.studies.study.code_hash", lambda: "another")
    with pytest.raises(InputError, match="the code of cellctl"):
        run_study(study, tmp_path / "studies", nothing, silent)


def test_a_worker_with_other_code_computes_nothing():
    with pytest.raises(InputError, match="another version of cellctl"):
        by_same_code("another", nothing, rows=20)


def test_without_the_extra_the_message_says_what_to_install(tmp_path, monkeypatch):
    for module in (cluster, row_table):
        monkeypatch.setattr(module, "has_package", lambda name: False)
    with pytest.raises(InputError, match=r"not installed: dask, distributed\n.*cellctl\[study\].*--processes"):
        on_cluster(None, 1, lambda _: None)
    with pytest.raises(InputError, match=r"pyarrow is missing\n.*cellctl\[study\]"):
        run_study(study_of(tmp_path), tmp_path / "studies", nothing, silent)


@pytest.mark.long
def test_two_workers_and_one_process_give_the_same_bytes(tmp_path):
    study = study_of(tmp_path)
    for name, compute in (("one", in_processes(1)), ("two", on_cluster(None, 2, lambda _: None))):
        run_study(study, tmp_path / name, compute, silent)
    one, two = ((tmp_path / name / "fits" / "rows.parquet").read_bytes() for name in ("one", "two"))
    assert one == two


@pytest.mark.long
@pytest.mark.parametrize("keep", ["none", "all"])
def test_a_campaign_has_a_run_folder_of_its_own_that_is_kept_by_choice(tmp_path, keep):
    touches_procedure(tmp_path, fit=5)
    text = f"study: campaign\nname: touches\nsettings: {{procedure: touches.yaml, cell: {CELL}}}\nkeep: {keep}\n"
    run_study(study_of(tmp_path, text), tmp_path / "studies", here, silent)
    (row,) = load(tmp_path / "studies" / "touches" / ROWS)
    assert (row["state"], row["points"]) == ("finished", 6)
    kept = list((tmp_path / "studies" / "touches").glob("runs/*/*/journal.sqlite"))
    assert len(kept) == (1 if keep == "all" else 0)


def test_the_command_refuses_two_ways_of_computing(tmp_path):
    (tmp_path / "study.yaml").write_text(FITS)
    done = cellctl("study", tmp_path / "study.yaml", "--workers", "2", "--processes", "2")
    assert done.returncode == 2
    assert "does not go with" in done.stderr


@pytest.mark.long
def test_the_command_prints_where_rows_and_page_are(tmp_path):
    (tmp_path / "study.yaml").write_text(FITS.replace("[20, 30]", "[20]").replace("count: 2", "count: 1"))
    words = ("--studies", tmp_path, "--processes", "1", "--json", "-")
    done = cellctl("study", tmp_path / "study.yaml", *words)
    found = json.loads(done.stdout)
    assert (done.returncode, found["units"], found["rows_now"]) == (0, 2, 2)
    assert parquet.read_table(found["table"]).num_rows == 2
