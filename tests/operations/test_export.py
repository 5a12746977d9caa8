"""Exports of a run: what other programs read, for complete, running, aborted and damaged runs."""

from __future__ import annotations

import csv
import io
import json
import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import event_model
import pytest
from pyarrow import parquet

from cellctl.cli import exit_codes
from cellctl.cli.exit_codes import Exit
from cellctl.cli.verbs import app
from cellctl.files import sha256_of
from cellctl.journal import (
    DevicesConnected,
    Journal,
    KnownEvent,
    Outcome,
    ReadableJournal,
    Recorded,
    RunEnded,
    RunStarted,
    SourceFile,
    StateChanged,
    StepEnded,
    StepStarted,
)
from cellctl.operations.export import Form, export_run

JOINTS = [10.5, -75.0, 88.125, 14.0, 47.5, -13.25]
DATA = "A1,A2\n1,2\n"
FINISHED = (StateChanged("running", "finished"), RunEnded("finished", "better"))
STARTED = RunStarted(
    procedure=SourceFile("procedures/touches.yaml", "procedure: touches\n", ""),
    cell=SourceFile("cell.yaml", "name: a cell\n", ""),
    parameters={"touches": 2},
    seed=7,
    clock="lockstep",
    operator="kai",
    calendar="2026-11-21T20:30:02Z",
    code_sha256="",
    versions={"cellctl": "0.1.0"},
    name="touches-1",
)
POINT = {"xyz": [2500.0, -600.0, 900.0], "covariance": [[1e-4, 0, 0], [0, 4e-4, 0], [0, 0, 9e-4]], "weather": None}


def attempt(number: int, outcome: Outcome) -> list[KnownEvent]:
    row = {"joints": JOINTS, "sphere": "S1", "attempt": number, "sigma_mm": 0.01 * number}
    return [
        StepStarted("points[0].touch", number, True, "sphere.touch"),
        Recorded("touch", row, "points[0].touch", number, measurement=True),
        StepEnded("points[0].touch", number, outcome),
    ]


EVENTS: list[KnownEvent] = [
    STARTED,
    StateChanged("idle", "running"),
    DevicesConnected({"robot": {"model": "KR5", "serial": "SIM-1", "firmware": "8.6", "simulated": True}}),
    *attempt(1, Outcome.FAILED),
    *attempt(2, Outcome.DONE),
    Recorded("nest", {"nest": "N1", "point": POINT}),
    Recorded("artefact", {"name": "dataset.csv", "sha256": sha256_of(DATA), "size": len(DATA)}),
    Recorded("residuals", {"point": ["S1", "S2"], "readings": [JOINTS, JOINTS]}),
]


@contextmanager
def writing(folder: Path, *ending: KnownEvent) -> Iterator[Path]:
    folder.mkdir(parents=True)
    ticks = count(0, 500_000_000)
    (folder / "dataset.csv").write_text(DATA)
    with Journal.create(folder, lambda: next(ticks)) as journal:
        for event in [*EVENTS, *ending]:
            journal.append(event)
        yield folder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    with writing(tmp_path / "runs" / "touches-1", *FINISHED) as folder:
        return folder


def changed(run: Path, seq: int, data: str) -> Path:
    with sqlite3.connect(run / "journal.sqlite") as connection:
        connection.execute("DROP TRIGGER events_are_not_changed")
        connection.execute("UPDATE events SET data = ? WHERE seq = ?", (data, seq))
    return run


def command(*words: str | Path) -> int:
    return exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


def samples_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def documents_of(run: Path) -> list[tuple[str, dict[str, Any]]]:
    return [tuple(json.loads(line)) for line in export_run(run, Form.BLUESKY).content.decode().splitlines()]


def archive_of(run: Path) -> zipfile.ZipFile:
    return zipfile.ZipFile(io.BytesIO(export_run(run, Form.ZIP).content))


def test_csv_has_a_row_for_each_sample_with_every_digit(run: Path) -> None:
    rows = samples_of(export_run(run, Form.CSV).content.decode())
    assert [(row["kind"], row["attempt"], row["counts"]) for row in rows] == [
        ("touch", "1", "false"),
        ("touch", "2", "true"),
        ("nest", "0", "true"),
    ]
    assert [float(rows[0][f"joints_A{axis}"]) for axis in range(1, 7)] == JOINTS
    assert (rows[0]["time_s"], rows[0]["sphere"], rows[0]["point_xyz_x"]) == ("2.0", "S1", "")
    assert (rows[2]["point_xyz_z"], rows[2]["point_covariance_y_y"], rows[2]["joints_A1"]) == ("900.0", "0.0004", "")


def test_parquet_has_the_rows_of_the_csv_with_types_and_units(run: Path) -> None:
    table = parquet.read_table(io.BytesIO(export_run(run, Form.PARQUET).content))
    rows = samples_of(export_run(run, Form.CSV).content.decode())
    assert table.column_names == list(rows[0])
    assert table.column("joints_A3").to_pylist() == [88.125, 88.125, None]
    assert table.column("counts").to_pylist() == [False, True, True]
    units = {name: (table.schema.field(name).metadata or {}).get(b"unit") for name in table.column_names}
    assert (units["joints_A1"], units["sigma_mm"], units["point_covariance_x_x"]) == (b"deg", b"mm", b"mm^2")
    assert units["sphere"] is None


def test_without_pyarrow_the_command_says_how_to_install_it(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cellctl.operations.export.samples.installed", lambda: False)
    assert command("export", run, "--as", "parquet", "-o", tmp_path / "s.parquet") == Exit.BAD_INPUT
    assert "pip install 'cellctl[parquet]'" in capsys.readouterr().err
    assert not (tmp_path / "s.parquet").exists()
    assert "exports/samples.parquet" not in archive_of(run).namelist()


def test_json_lines_have_every_event_with_all_fields_of_the_journal(run: Path) -> None:
    changed(run, 11, '{"row_kind": "nest", "data": {}, "of_a_newer_version": 1}')
    lines = [json.loads(line) for line in export_run(run, Form.JSONL).content.decode().splitlines()]
    assert [line["seq"] for line in lines] == list(range(1, len(EVENTS) + 3))
    assert lines[0]["kind"] == "run_started"
    assert lines[0]["data"]["operator"] == "kai"
    assert lines[10]["data"]["of_a_newer_version"] == 1


def test_bluesky_documents_are_valid_and_refer_to_each_other(run: Path) -> None:
    documents = documents_of(run)
    for name, document in documents:
        event_model.schema_validators[event_model.DocumentNames[name]].validate(document)
    start, stop = documents[0][1], documents[-1][1]
    descriptors = {each["uid"]: each for name, each in documents if name == "descriptor"}
    events = [each for name, each in documents if name == "event"]
    assert [each["name"] for each in descriptors.values()] == ["touch", "nest"]
    assert {each["run_start"] for each in (*descriptors.values(), stop)} == {start["uid"]}
    assert all(set(each["data"]) == set(descriptors[each["descriptor"]]["data_keys"]) for each in events)
    assert (stop["exit_status"], stop["num_events"]) == ("success", {"touch": 2, "nest": 1})
    touch = descriptors[events[0]["descriptor"]]["data_keys"]["joints_A1"]
    assert (touch["units"], touch["dtype"]) == ("deg", "number")
    assert (start["time"], events[0]["time"]) == (1795293002.0, 1795293004.0)


def test_the_same_run_gives_the_same_bytes(run: Path) -> None:
    for form in set(Form) - {Form.DCC}:  # a certificate needs an identification: tests/report/test_certificate.py
        assert export_run(run, form).content == export_run(run, form).content


def test_the_zip_has_everything_and_a_readme_that_names_each_file_with_units(run: Path, tmp_path: Path) -> None:
    with archive_of(run) as archive:
        names = set(archive.namelist())
        readme = archive.read("README.txt").decode()
        archive.extractall(tmp_path / "copy")
    assert names == {
        "README.txt", "journal.sqlite", "dataset.csv", "report.html", "sources/procedure.yaml", "sources/cell.yaml",
        "exports/samples.csv", "exports/samples.parquet", "exports/events.jsonl", "exports/bluesky.jsonl",
    }  # fmt: skip
    assert all(f"  {name} " in readme for name in names - {"README.txt"})
    assert any(line.split() == ["joints_A1", "deg"] for line in readme.splitlines())
    assert ReadableJournal.of(tmp_path / "copy").rows == ReadableJournal.of(run).rows


def test_a_running_run_is_exported_as_far_as_it_is(tmp_path: Path) -> None:
    with writing(tmp_path / "run") as folder:
        assert [name for name, _ in documents_of(folder)][-1] == "event", "a running run has no stop document"
        with archive_of(folder) as archive:
            archive.extract("journal.sqlite", tmp_path / "copy")
        assert len(ReadableJournal.of(tmp_path / "copy").rows) == len(EVENTS)


@pytest.mark.parametrize(
    ("ending", "status", "reason"),
    [
        ((RunEnded("aborted", "", "by the operator"),), "abort", "by the operator"),
        ((RunEnded("failed", "", "probe: lost"),), "fail", "probe: lost"),
        ((), "fail", "cut off while running"),
    ],
)
def test_a_run_without_success_has_a_stop_document_that_says_so(
    tmp_path: Path, ending: tuple[KnownEvent, ...], status: str, reason: str
) -> None:
    with writing(tmp_path / "run", *ending) as folder:
        pass
    name, stop = documents_of(folder)[-1]
    assert (name, stop["exit_status"], stop["reason"]) == ("stop", status, reason)


def test_of_a_damaged_run_the_rest_is_exported_and_the_damage_is_named(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed(run, 5, '{"row_kind": 3}')
    (run / "dataset.csv").write_text("A1\n9\n")
    out = tmp_path / "all.zip"
    assert command("export", run, "-o", out) == Exit.BAD_INPUT
    said = capsys.readouterr().err
    assert "event 5 is damaged" in said
    assert "dataset.csv: it is here as it is now; it was changed after the run made it" in said
    with zipfile.ZipFile(out) as archive:
        rows = samples_of(archive.read("exports/samples.csv").decode())
        assert [row["seq"] for row in rows] == ["8", "10"]
        assert "event 5 is damaged" in archive.read("README.txt").decode()


def test_events_on_a_damaged_page_are_counted_and_the_others_exported(tmp_path: Path) -> None:
    with writing(tmp_path / "run", *(Recorded("touch", {"joints": JOINTS, "number": n}) for n in range(400))) as folder:
        pass
    file = folder / "journal.sqlite"
    content = bytearray(file.read_bytes())
    middle = len(content) // 2 // 4096 * 4096
    content[middle : middle + 4096] = b"\xff" * 4096
    file.write_bytes(content)
    found = export_run(folder, Form.JSONL)
    assert 300 < found.events < 400 + len(EVENTS)
    assert len(found.content.splitlines()) == found.events
    assert f"{400 + len(EVENTS) - found.events} of {400 + len(EVENTS)} events cannot be read" in found.missing[0]


def test_a_zip_saves_the_files_of_a_run_whose_journal_cannot_be_read(run: Path, tmp_path: Path) -> None:
    (run / "journal.sqlite").write_bytes(b"no journal" * 100)
    assert command("export", run, "--as", "csv", "-o", tmp_path / "s.csv") == Exit.BAD_INPUT
    assert not (tmp_path / "s.csv").exists()
    found = export_run(run, Form.ZIP)
    with zipfile.ZipFile(io.BytesIO(found.content)) as archive:
        assert archive.read("dataset.csv").decode() == DATA
        assert archive.read("journal.sqlite") == b"no journal" * 100
    assert any(each.startswith("exports: it is no journal") for each in found.missing)


def test_the_command_finds_a_run_by_name_and_states_what_it_wrote(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "samples.csv"
    words = ("export", "touches-1", "--runs", run.parent, "--as", "csv", "-o", out, "--json", "-")
    assert command(*words) == Exit.GOOD
    assert json.loads(capsys.readouterr().out) == {
        "run": "touches-1", "form": "csv", "file": str(out), "samples": 3, "events": len(EVENTS) + 2, "missing": [],
    }  # fmt: skip
    assert out.read_bytes() == export_run(run, Form.CSV).content


def test_no_file_of_the_run_is_overwritten(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    for name in ("journal.sqlite", "dataset.csv"):
        assert command("export", run, "-o", run / name) == Exit.BAD_INPUT
        assert "it would be written over" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before


def test_a_run_that_does_not_exist_is_refused_with_the_cure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("export", "nowhere", "--runs", tmp_path, "-o", tmp_path / "x.zip") == Exit.BAD_INPUT
    assert "there is no journal" in capsys.readouterr().err
