"""Folds in processes of their own: the same bytes as in one, whatever happens to these processes."""

import json
import sys

import pytest

from cellctl.operations import fold_processes
from cellctl.operations.worker import WORKER

FIT = ("fit", "robot.yaml", "touches.csv", "--artefact", "artefact.yaml", "--model", "geometry", "--folds", "3")


def result(cellctl, folder, *words):
    """Model file and report, without the seconds that it took."""
    cellctl(*FIT, *words, "--out", "model.json", "--json", "report.json")
    report = json.loads((folder / "report.json").read_text())
    report.pop("seconds")
    return (folder / "model.json").read_bytes(), report


@pytest.fixture
def alone(cellctl, files):
    return result(cellctl, files, "--processes", "1")


@pytest.mark.long
@pytest.mark.parametrize("processes", [2, 8])
def test_the_result_is_that_of_one_process(cellctl, files, alone, monkeypatch, processes):
    taken = []
    results = fold_processes._Process.results
    monkeypatch.setattr(fold_processes._Process, "results", lambda self: taken.append(results(self)) or taken[-1])
    assert result(cellctl, files, "--processes", processes) == alone
    assert [len(each) for each in taken] == [1] * (min(processes, 3) - 1)


@pytest.mark.parametrize(
    "worker",
    [
        "import sys; sys.exit(1)",
        "import os, signal, sys; sys.stdin.read(); os.kill(os.getpid(), signal.SIGKILL)",
        'import sys; sys.stdin.read(); print(\'{"fold": 1, "held\')',
    ],
)
def test_what_a_process_did_not_compute_is_computed_here(cellctl, files, alone, monkeypatch, worker):
    monkeypatch.setattr(fold_processes, "WORKER", (sys.executable, "-c", worker))
    assert result(cellctl, files, "--processes", "3") == alone


def test_a_short_fit_starts_no_process(cellctl, files, alone, monkeypatch):
    monkeypatch.setattr(fold_processes, "WORKER", None)
    assert result(cellctl, files) == alone


def test_a_fit_whose_folds_take_long_starts_processes_without_being_asked(cellctl, files, alone, monkeypatch):
    started = []
    monkeypatch.setattr(fold_processes, "WORTH_S", 0.0)
    monkeypatch.setattr(fold_processes, "processors", lambda: 3)
    monkeypatch.setattr(fold_processes, "WORKER", (*WORKER[:1], "-c", "pass"))
    process = fold_processes._Process.__init__
    monkeypatch.setattr(
        fold_processes._Process, "__init__", lambda self, *given: started.append(given[1]) or process(self, *given)
    )
    assert result(cellctl, files) == alone
    assert started == [(1,), (2,)]
