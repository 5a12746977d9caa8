"""`cellctl.open_run`: what `cellctl show` says, with model, data, table and events."""

import json

import pytest

import cellctl
from cellctl.files import sha256_of
from cellctl.journal import DevicesConnected, Journal, Recorded, RunEnded, RunStarted, SourceFile, StateChanged
from tests.helpers.arms import cellctl as command
from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv

VERDICT = {
    "verdict": "better",
    "sentence": "Error of the held-out targets: 0.500 mm before, 0.040 mm after. Better than nominal.",
    "before": {"mean": 0.5, "rms": 0.6, "max": 1.1},
    "after": {"mean": 0.04, "rms": 0.05, "max": 0.09},
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """`runs/made`: a finished run with model and data set."""
    run = tmp_path / "runs" / "made"
    text = "procedure: made\ntitle: A run made here\n"
    file = SourceFile("made.yaml", text, sha256_of(text))
    identity = {"model": "KR5", "serial": "SIM-7", "firmware": "8.6", "simulated": True}
    with Journal.create(run, lambda: 0) as journal:
        journal.append(RunStarted(file, file, {}, 1, "lockstep", "me", "2026-11-21T00:00:00Z", "0", {}))
        journal.append(StateChanged("connecting", "running"))
        journal.append(DevicesConnected({"robot": identity}))
        journal.append(Recorded("verdict", VERDICT))
        journal.append(RunEnded("finished", "better"))
    kr5_model().save(run / "model.json")
    (run / "dataset.csv").write_text("A1,X\n1.0,2.0\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_run_by_name_and_by_folder_is_that_of_show(folder):
    assert command("show", "made", "--json", "shown.json") == 0
    shown = json.loads((folder / "shown.json").read_text())
    for run in (cellctl.open_run("made"), cellctl.open_run(folder / "runs" / "made", runs="elsewhere")):
        assert json.loads(json.dumps(run.report)) == shown
        assert (run.state, run.verdict, run.sentence) == ("finished", "better", VERDICT["sentence"])
        assert (run.before, run.after) == (VERDICT["before"], VERDICT["after"])


def test_model_data_and_events_of_a_run(folder):
    run = cellctl.open_run("made")
    assert run.data["X"].tolist() == [2.0]
    assert run.model.file.text() == kr5_model().text()
    assert run.table is None
    kinds = [event["kind"] for event in run.events()]
    assert kinds == ["run_started", "state_changed", "devices_connected", "recorded", "run_ended"]


def test_the_model_of_a_run_makes_tables_for_the_controller_of_that_run(folder):
    (folder / "targets.csv").write_text(targets_csv(readings_near_the_middle(2)))
    table = cellctl.open_run("made").model.compensate("targets.csv").table()
    assert (table.robot.serial, table.simulated, table.source.run) == ("SIM-7", True, "made")
    table.save(folder / "runs" / "made" / "table.json")
    assert cellctl.open_run("made").table.id == table.id


def test_the_page_of_a_run_is_that_of_the_command(folder):
    assert command("report", "made", "-o", "command.html") == 0
    assert cellctl.open_run("made").page("python.html") == (folder / "command.html").read_text()
    assert (folder / "python.html").read_text() == (folder / "command.html").read_text()


def test_a_run_that_does_not_exist_is_refused(folder):
    with pytest.raises(cellctl.InputError, match="there is no journal"):
        cellctl.open_run("other")
