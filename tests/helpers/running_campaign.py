"""A small campaign with a `confirm` step and an interlock, which runs in a thread as another process would run it."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path
from typing import Any

from cellctl.clock import WallClock
from cellctl.engine import Engine, Mailbox, Plan, Surround
from cellctl.files import parse_yaml, sha256_of
from cellctl.journal import Journal, RunStarted, SourceFile, fold, read_journal
from cellctl.procedure import StepRegistry, read_procedure
from tests.helpers.engine import KINDS, FakeGate

PATIENCE_S = 60.0

TEXT = """
procedure: test
title: a test
cell: cell.yaml
interlocks:
  - {id: door, device: gate, condition: closed}
steps:
  - {id: some, do: test.numbers}
  - {id: clear, confirm: Clear the cell}
  - id: all
    for_each: ${some.values}
    as: number
    steps:
      - {id: twice, do: test.double, with: {value: "${number}"}}
  - {id: wait, do: test.forever}
"""


class Running:
    """A campaign that runs in a thread, as another process would run it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.gate = folder, FakeGate("gate")
        self.outcome: Any = None
        self.thread = threading.Thread(target=lambda: asyncio.run(self.run()), daemon=True)
        self.thread.start()

    async def run(self) -> None:
        clock = WallClock()
        procedure = read_procedure(parse_yaml(TEXT, "test.yaml"))
        surround = Surround(clock, 1, self.folder, parse_yaml("name: x", "c.yaml"), self.folder, {"gate": self.gate})
        with Journal.create(self.folder, clock.now_ns) as journal:
            source = SourceFile("test.yaml", TEXT, sha256_of(TEXT))
            started = journal.append(RunStarted(source, source, {}, 1, "realtime", "me", "now", "", {}))
            plan = Plan(procedure, {}, StepRegistry(KINDS), {"gate": self.gate})
            self.outcome = await Engine(plan, surround, journal, Mailbox(), None, fold([started])).run()

    def events(self, kind: type) -> list[Any]:
        return [entry.event for entry in read_journal(self.folder) if isinstance(entry.event, kind)]
