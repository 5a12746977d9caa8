"""A run that another process starts goes on without it, and a run that ended early continues at its failed step."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.engine import Operator
from cellctl.files import InputError
from cellctl.journal import OperatorAction, RunResumed, RunState, StepStarted, fold, read_journal, writer_of
from cellctl.operations.run_control import RunOrder, act, question_of, resume_detached, start_detached
from tests.helpers.runs import CELL, PATIENCE_S, ROOT, child, touches_procedure

ADA = Operator("Ada", "tablet", "console")
STARTER = """
import asyncio, sys
from pathlib import Path
from cellctl.operations.run_control import RunOrder, start_detached
order = RunOrder(Path(sys.argv[1]), Path(sys.argv[2]), seed=2)
print(asyncio.run(start_detached(order, Path(sys.argv[3]), "Ada")), flush=True)
input()
"""


async def ended(folder: Path) -> RunState:
    async with asyncio.timeout(PATIENCE_S):
        while writer_of(folder):
            await WallClock().sleep(0.1)
    return fold(read_journal(folder))


async def at_step(folder: Path, step: str) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not any(isinstance(e.event, StepStarted) and e.event.step == step for e in read_journal(folder)):
            await WallClock().sleep(0.05)


@pytest.mark.long
def test_a_procedure_with_errors_is_refused_with_each_at_its_line_and_leaves_no_folder(tmp_path: Path) -> None:
    procedure = touches_procedure(tmp_path)
    procedure.write_text(procedure.read_text().replace("sphere.plan", "sphere.plam").replace("speed_mm_s", "speed"))
    with pytest.raises(InputError) as refused:
        asyncio.run(start_detached(RunOrder(procedure, CELL), tmp_path / "runs", "Ada"))
    assert {6, 15} <= {problem.line for problem in refused.value.problems}
    assert list((tmp_path / "runs").iterdir()) == []


@pytest.mark.long
def test_killing_the_starter_does_not_touch_the_run_and_the_journal_names_the_operator(tmp_path: Path) -> None:
    words = [sys.executable, "-c", STARTER, str(touches_procedure(tmp_path, 5)), str(CELL), str(tmp_path / "runs")]
    with child(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as starter:
        assert starter.stdout
        folder = Path(starter.stdout.readline().strip())
        os.kill(starter.pid, signal.SIGKILL)
    state = asyncio.run(ended(folder))
    assert state.state == "finished"
    assert state.started
    assert state.started.operator == "Ada"
    assert "cell: sphere cell (simulated)" in (folder / "output.txt").read_text()


@pytest.mark.long
def test_an_aborted_run_continues_at_its_step_and_one_that_was_killed_asks_first(tmp_path: Path) -> None:
    async def lived() -> None:
        order = RunOrder(touches_procedure(tmp_path, 6), CELL, seed=2)
        folder = await start_detached(order, tmp_path / "runs", "Ada")
        await at_step(folder, "points[1].touch")
        assert not (await act(folder, "abort", ADA)).refused
        assert (await ended(folder)).state == "aborted"
        assert question_of(folder) == ""
        await resume_detached(folder, "Grace", acknowledged=False)
        await at_step(folder, "points[3].touch")
        writer = writer_of(folder)
        assert writer
        os.kill(int(writer.pid), signal.SIGKILL)
        await ended(folder)
        assert "what it did last is not known" in question_of(folder)
        with pytest.raises(InputError, match="what it did last is not known"):
            await resume_detached(folder, "Grace", acknowledged=False)
        await resume_detached(folder, "Grace", acknowledged=True)
        assert (await ended(folder)).state == "finished"
        events = [entry.event for entry in read_journal(folder)]
        assert [event.operator for event in events if isinstance(event, RunResumed)] == ["Grace", "Grace"]
        assert [(e.action, e.operator) for e in events if isinstance(e, OperatorAction)] == [
            ("abort", "Ada"),
            ("acknowledge", "Grace"),
        ]

    asyncio.run(lived())
