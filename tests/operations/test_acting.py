"""Actions on a running campaign from another process: each operator is named, and no stale confirmation counts."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.engine import Operator
from cellctl.files import InputError
from cellctl.journal import OperatorAction, fold, read_journal, writer_of
from cellctl.operations.run_control import act
from tests.helpers.engine import PATIENCE_S, Running

MARIA = Operator("maria", "tablet", "console")


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    found = Running(tmp_path / "test-1")
    asyncio.run(until_asked(found.folder))
    yield found
    if writer_of(found.folder):
        asyncio.run(act(found.folder, "abort", MARIA))
    found.thread.join(PATIENCE_S)


async def until_asked(folder: Path) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not (
            (folder / "journal.sqlite").exists()
            and any(s.step == "clear" for s in fold(read_journal(folder)).in_flight)
        ):
            await WallClock().sleep(0.02)


def test_a_confirmation_of_another_step_is_refused_and_the_right_one_is_recorded_with_its_step(
    running: Running,
) -> None:
    stale = asyncio.run(act(running.folder, "confirm", MARIA, "mount"))
    assert stale.refused == "the run waits for the confirmation of 'clear', not of 'mount'"
    done = asyncio.run(act(running.folder, "confirm", MARIA, "clear"))
    assert (done.refused, done.text, done.operator, done.host, done.via) == ("", "clear", "maria", "tablet", "console")
    assert [action.action for action in running.events(OperatorAction)] == ["confirm", "confirm"]


def test_an_action_on_a_run_that_has_ended_is_refused_and_leaves_no_file(running: Running) -> None:
    done = asyncio.run(act(running.folder, "abort", MARIA, "wrong sphere"))
    assert (done.text, done.refused) == ("wrong sphere", "")
    running.thread.join(PATIENCE_S)
    with pytest.raises(InputError, match="this run is not running"):
        asyncio.run(act(running.folder, "pause", MARIA))
    assert not (running.folder / "mailbox").exists()
