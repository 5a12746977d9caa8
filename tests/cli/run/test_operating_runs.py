"""`status`, `pause`, `continue`, `confirm`, `abort`: what another process sees of a running campaign and does to it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cellctl.cli.exit_codes import Exit, exit_code_of
from cellctl.cli.verbs import app
from cellctl.journal import OperatorAction
from tests.helpers.engine import PATIENCE_S, Running


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    found = Running(tmp_path / "runs" / "test-1")
    yield found
    if found.thread.is_alive():
        cellctl("abort", tmp_path)
    found.thread.join(PATIENCE_S)
    assert not found.thread.is_alive()


def cellctl(verb: str, folder: Path, *more: str) -> int:
    return exit_code_of(lambda: app([verb, "--runs", str(folder / "runs"), *more], standalone_mode=False))


def status(folder: Path, capsys: Any, ready: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The status, once `ready` says that it is the one that is waited for."""

    async def asked() -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE_S):
            while True:
                capsys.readouterr()
                if cellctl("status", folder, "--json", "-") == Exit.GOOD:
                    found: dict[str, Any] = json.loads(capsys.readouterr().out)
                    if ready(found):
                        return found
                await asyncio.sleep(0.05)

    return asyncio.run(asked())


def test_another_process_sees_confirms_pauses_continues_and_aborts(running: Running, tmp_path: Path, capsys) -> None:
    found = status(tmp_path, capsys, lambda found: bool(found["confirm"]))
    assert (found["state"], found["step"], found["confirm"]) == ("running", "clear", "Clear the cell")
    assert (found["done"], found["total"]) == (1, 6)
    assert cellctl("continue", tmp_path) == Exit.BAD_INPUT
    assert "the run is not paused" in capsys.readouterr().err
    assert cellctl("confirm", tmp_path) == Exit.GOOD
    assert status(tmp_path, capsys, lambda found: found["step"] == "wait")["done"] == 5
    running.gate.closed = False
    found = status(tmp_path, capsys, lambda found: found["state"] == "paused")
    assert found["held_by"] == "interlock 'door' does not hold (gate: closed)"
    assert cellctl("status", tmp_path) == Exit.GOOD
    assert "held by    interlock 'door' does not hold" in capsys.readouterr().out
    running.gate.closed = True
    status(tmp_path, capsys, lambda found: not found["broken"])
    assert cellctl("continue", tmp_path) == Exit.GOOD
    assert cellctl("pause", tmp_path) == Exit.GOOD
    assert cellctl("abort", tmp_path, "test-1") == Exit.GOOD
    running.thread.join(PATIENCE_S)
    assert running.outcome.state == "aborted"
    actions = running.events(OperatorAction)
    assert [(action.action, action.via) for action in actions] == [
        (name, "cli") for name in ("resume", "confirm", "resume", "pause", "abort")
    ]
    assert all(action.operator and action.host and action.calendar for action in actions)


def test_a_run_that_is_not_running_is_named_and_nothing_is_left_in_it(running: Running, tmp_path: Path, capsys) -> None:
    status(tmp_path, capsys, lambda found: bool(found["confirm"]))
    assert cellctl("abort", tmp_path) == Exit.GOOD
    running.thread.join(PATIENCE_S)
    capsys.readouterr()
    assert cellctl("pause", tmp_path, "test-1") == Exit.BAD_INPUT
    assert "this run is not running" in capsys.readouterr().err
    assert cellctl("pause", tmp_path) == Exit.BAD_INPUT
    assert "no run is running here" in capsys.readouterr().err
    assert cellctl("status", tmp_path, "test-2") == Exit.BAD_INPUT
    assert "there is no run here" in capsys.readouterr().err
    assert not (running.folder / "mailbox").exists()
    assert cellctl("status", tmp_path, "test-1") == Exit.GOOD
    shown = capsys.readouterr().out
    assert shown.startswith("test-1: aborted\n")
    assert "nothing was moved" in shown
    assert cellctl("status", tmp_path, "test-1", "--json", "-") == Exit.GOOD
    found = json.loads(capsys.readouterr().out)
    again = "continue it with `cellctl run test.yaml --resume test-1`"
    assert (found["problem"], found["cure"]) == ("aborted by the operator", again)
    assert found["sentence"].startswith("Aborted: aborted by the operator. C")
