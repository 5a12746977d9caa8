"""On a terminal the operator confirms a `confirm` step with the Enter key."""

from __future__ import annotations

import asyncio
import os
import sys
from typing import final

from cellctl.engine import Mailbox, Operator, Watcher
from cellctl.journal import KnownEvent, Said, StepEnded, StepStarted

_HOW = "press Enter to confirm, Ctrl-C to abort; from another terminal: `cellctl confirm`"


def interactive() -> bool:
    """Whether an operator can be asked: standard input and error are a terminal that the system can monitor."""
    return os.name == "posix" and sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


@final
class ConfirmingAtTerminal:
    """A watcher that passes everything on to `shown`, and reads the terminal while a `confirm` step waits."""

    def __init__(self, shown: Watcher, mailbox: Mailbox) -> None:
        self._shown, self._mailbox = shown, mailbox
        self._waiting = ""

    def event(self, event: KnownEvent) -> None:
        """Pass the event on; read from a `confirm` step's text to the end of the step."""
        self._shown.event(event)
        match event:
            case StepStarted(step=step, do="confirm"):
                self._waiting = step
            case Said(step=step) if step and step == self._waiting:
                self._shown.event(Said(_HOW))
                asyncio.get_running_loop().add_reader(sys.stdin.fileno(), self._read)
            case StepEnded(step=step) if step == self._waiting:
                self._leave()
            case _:
                pass

    def loop(self, path: str, index: int, count: int) -> None:
        """Pass it on."""
        self._shown.loop(path, index, count)

    def _read(self) -> None:
        terminal = sys.stdin.fileno()
        if os.getpgrp() != os.tcgetpgrp(terminal):  # in the background: reading would stop this process
            self._leave()
            return
        line = os.read(terminal, 4096)
        if not line:
            self._leave()
        elif line.strip().lower() in (b"", b"y", b"yes"):
            self._mailbox.confirm(Operator.here("terminal"))
        else:
            self._shown.event(Said(_HOW))

    def _leave(self) -> None:
        self._waiting = ""
        asyncio.get_running_loop().remove_reader(sys.stdin.fileno())
