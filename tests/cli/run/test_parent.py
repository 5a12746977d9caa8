"""A run ends with the process that started it, unless it was started detached."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.runs import child

PATIENCE_S = 120.0

WAITING = """
import threading, os
from cellctl.operations.launch import aborting_without, parent_of_run
ended = threading.Event()
def abort(why):
    print(why, flush=True)
    ended.set()
with aborting_without(parent_of_run(detached=False), abort):
    print(f"watching {os.getppid()}", flush=True)
    ended.wait(60)
"""

STARTING = """
import subprocess, sys
subprocess.run([sys.executable, "-c", sys.argv[1]])
"""

ASKING = "from cellctl.operations.launch import parent_of_run; print(parent_of_run(detached={detached}))"


def test_kill_minus_nine_of_the_parent_is_seen_and_named() -> None:
    command = [sys.executable, "-c", STARTING, WAITING]
    with child(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == f"watching {parent.pid}\n"
        parent.kill()
        said = parent.stdout.read()
    assert f"process {parent.pid} (" in said
    assert "which started this run, has ended" in said
    assert "--detached" in said


@pytest.mark.long
@pytest.mark.parametrize(
    ("before", "detached", "session"),
    [([], True, False), (["nohup"], False, False), ([], False, True)],
    ids=["--detached", "nohup", "setsid"],
)
def test_a_detached_run_has_no_parent(before: list[str], detached: bool, session: bool, tmp_path: Path) -> None:
    assert asked(before, detached=detached, session=session, folder=tmp_path) == "None"


@pytest.mark.long
def test_a_run_that_was_started_from_a_shell_or_a_script_has_its_parent(tmp_path: Path) -> None:
    assert asked([], detached=False, session=False, folder=tmp_path) == str(os.getpid())


def asked(before: list[str], *, detached: bool, session: bool, folder: Path) -> str:
    command = [*before, sys.executable, "-c", ASKING.format(detached=detached)]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE_S, check=True, start_new_session=session, cwd=folder
    )
    return done.stdout.strip()
