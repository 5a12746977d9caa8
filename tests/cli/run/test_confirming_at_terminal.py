"""A `confirm` step at a terminal: Enter confirms, other words do not."""

from __future__ import annotations

import asyncio
import os
import pty
import sys
from pathlib import Path
from typing import Any

import pytest

from cellctl.cli.run_progress import ConfirmingAtTerminal
from cellctl.engine import NobodyWatching, State
from cellctl.journal import OperatorAction
from tests.helpers.engine import CALLS, engine_for, events_of

STEPS = "  - {id: clear, confirm: Clear the cell}\n  - {id: hold, do: test.hold}"


@pytest.mark.parametrize("words", [b"\n", b"yes\n"])
def test_enter_confirms_and_another_word_does_not(words: bytes, tmp_path: Path, monkeypatch: Any) -> None:
    engine, mailbox, journal = engine_for(STEPS, tmp_path)
    keyboard, terminal = pty.openpty()
    with open(terminal, closefd=True) as stdin:  # noqa: PTH123 - a descriptor, not a path
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(os, "tcgetpgrp", lambda _: os.getpgrp())
        engine._recorder.watcher = ConfirmingAtTerminal(NobodyWatching(), mailbox)

        async def run() -> Any:
            running = asyncio.create_task(engine.run())
            async with asyncio.timeout(60):
                while not engine._record.in_flight:
                    await asyncio.sleep(0.01)
                os.write(keyboard, b"what?\n")
                await asyncio.sleep(0.1)
                assert CALLS == []
                os.write(keyboard, words)
                return await running

        assert asyncio.run(run()).state is State.FINISHED
    os.close(keyboard)
    (action,) = events_of(journal, OperatorAction)
    assert (action.action, action.via) == ("confirm", "terminal")
