"""The verbs that work on files run where there are no POSIX modules, as on Windows; `run` says what it needs."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cellctl.journal import Journal, RunEnded, RunStarted, SourceFile
from tests.helpers.runs import PATIENCE_S, ROOT, SELFCAL

INPUTS = ROOT / "tests" / "golden" / "inputs"
ROBOT = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
CELL = ROOT / "procedures" / "cells" / "sphere_cell.yaml"

WITHOUT = """
import asyncio, os, signal, sys  # asyncio has a form of its own for Windows, which needs none of these
for name in ("fcntl", "termios", "pty", "tty", "resource", "pwd", "grp"):
    sys.modules[name] = None
for name in ("O_DIRECTORY", "getsid", "getpgrp", "tcgetpgrp"):
    delattr(os, name)
del signal.SIGHUP
from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
sys.exit(exit_codes.exit_code_of(lambda: app(sys.argv[1:], standalone_mode=False)))
"""

DATA = """name,A1,A2,A3,A4,A5,A6,X,Y,Z
a,0,-90,90,0,45,0,1000,0,900
b,10,-80,95,5,50,10,1000,100,900
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "data.csv").write_text(DATA)
    run = tmp_path / "runs" / "made"
    source = SourceFile(str(CELL), CELL.read_text(), "0")
    with Journal.create(run, lambda: 0) as journal:
        journal.append(RunStarted(source, source, {}, 1, "lockstep", "me", "2026-11-21T00:00:00Z", "0", {}))
        journal.append(RunEnded("aborted", ""))
    return tmp_path


def without_posix(folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", WITHOUT, *map(str, words)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--help"], 0, "predict"),
        (["convert", ROBOT, "--to", "urdf", "-o", "robot.urdf"], 0, ""),
        (["import", "data.csv", "--unit", "mm", "-o", "rows.csv"], 0, "rows.csv: 2 rows"),
        (["runs"], 0, "made"),
        (["show", "made"], 0, "made: aborted"),
        (["report", "made"], 0, "report.html"),
        (["run", SELFCAL], 2, "Linux"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_verb_runs_without_posix_modules(words: list[object], code: int, said: str, folder: Path) -> None:
    done = without_posix(folder, *words)
    assert done.returncode == code, done.stderr
    assert said in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.long
def test_a_model_is_made_and_used_without_posix_modules(folder: Path) -> None:
    fit = ["fit", INPUTS / "six.yaml", INPUTS / "poses.csv", "--model", "geometry", "--report", "fit.html"]
    for words in (
        [*fit, "--out", "model.json", "--json", "fit.json"],
        ["predict", "model.json", INPUTS / "joints.csv", "-o", "predicted.csv"],
        ["compensate", "model.json", "predicted.csv", "--serial", "K1", "-o", "table.json"],
    ):
        done = without_posix(folder, *words)
        assert done.returncode == 0, done.stderr
    assert json.loads((folder / "fit.json").read_text())["verdict"] == "better"
    assert json.loads((folder / "table.json").read_text())["rows"]
