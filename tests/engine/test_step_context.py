"""What a step gets from its run: who the devices are, the date as a label, the name, and files with their hash."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Identity
from cellctl.engine import Context, Surround
from cellctl.files import InputError, parse_yaml, sha256_of
from cellctl.journal import (
    DevicesConnected,
    Entry,
    KnownEvent,
    Recorded,
    RunResumed,
    RunStarted,
    RunState,
    SourceFile,
    StepStarted,
)
from cellctl.procedure import NoInputs, StepContext, step
from cellctl.records import ArtefactRow

ROBOT = Identity("robot", "SIM-1", "KR5", "8.6", simulated=True)
FILE = SourceFile("x.yaml", "", "")
STARTED = RunStarted(FILE, FILE, {}, 1, "lockstep", "me", "2026-11-21T20:30:02Z", "", {}, name="a-run")
WHO = DevicesConnected(
    {"robot": {"device": "robot", "serial": "SIM-1", "model": "KR5", "firmware": "8.6", "simulated": True}}
)


@dataclass
class Run:
    """A journal in memory, and a step's context in it."""

    folder: Path
    state: RunState = field(default_factory=RunState)

    def append(self, event: KnownEvent) -> None:
        self.state.apply(Entry(self.state.last_seq + 1, 0, event))

    def context(self) -> Context:
        self.append(StepStarted("make", 1, moves=False))
        cell = parse_yaml("name: x", "cell.yaml")
        surround = Surround(WallClock(), 1, self.folder, cell, self.folder / "robot.yaml", {})
        return Context("make", 1, surround, frozenset(), self.state, self.append)


@pytest.fixture
def run(tmp_path: Path) -> Run:
    made = Run(tmp_path)
    made.append(STARTED)
    made.append(WHO)
    return made


def test_identities_date_and_name_are_those_of_the_journal(run: Run) -> None:
    context = run.context()
    assert context.identity("robot") == ROBOT
    assert (context.calendar, context.run_name) == ("2026-11-21T20:30:02Z", "a-run")
    run.append(RunResumed("me", "2026-11-22T08:00:00Z", "", {}))
    assert context.calendar == "2026-11-22T08:00:00Z"


def test_a_device_that_the_cell_does_not_have_is_named(run: Run) -> None:
    with pytest.raises(InputError, match="step make asks who 'tracker' is"):
        run.context().identity("tracker")


def test_in_a_journal_that_does_not_name_its_run_the_folder_does(tmp_path: Path) -> None:
    assert Run(tmp_path).context().run_name == tmp_path.name


@pytest.mark.parametrize("content", ["θ\n", b"\x00\x01"])
def test_a_file_is_written_and_recorded_with_its_hash(run: Run, content: Any) -> None:
    context = run.context()
    data = content if isinstance(content, bytes) else content.encode()
    sha256 = asyncio.run(context.write_artefact("model.json", content))
    assert (run.folder / "model.json").read_bytes() == data
    assert context.recorded(ArtefactRow) == [ArtefactRow("model.json", sha256_of(data), len(data))]
    assert sha256 == sha256_of(data)
    assert isinstance(run.state.rows[-1].event, Recorded)
    assert run.state.rows[-1].event.step == "make"


def test_a_file_of_the_run_is_read_only_as_it_was_written(run: Run) -> None:
    context = run.context()
    with pytest.raises(InputError, match=r"model\.json: is not there"):
        context.artefact("model.json")
    asyncio.run(context.write_artefact("model.json", "first"))
    asyncio.run(context.write_artefact("model.json", "second"))
    assert context.artefact("model.json").read_text() == "second"
    (run.folder / "model.json").write_text("first")
    with pytest.raises(InputError, match="has changed since this run wrote it"):
        context.artefact("model.json")
    context.run.recomputed = True
    assert context.artefact("model.json").read_text() == "first", "a replay compares files, and goes on"


def test_a_step_without_devices_computes() -> None:
    @step("test.compute")
    async def compute(context: StepContext, inputs: NoInputs) -> None:
        """Compute."""

    @step("test.write", moves=True)
    async def write(context: StepContext, inputs: NoInputs) -> None:
        """Write."""

    assert compute.computes
    assert not write.computes


def test_a_device_that_the_cell_may_lack_is_none_where_it_lacks_it(run: Run) -> None:
    context = run.context()
    context.uses = frozenset({"plc"})
    assert context.optional_device("plc") is None
    there: Any = object()
    context.run.devices["plc"] = there  # type: ignore[index]
    assert context.optional_device("plc") is there
    with pytest.raises(KeyError, match="does not declare that it uses 'probe'"):
        context.optional_device("probe")
