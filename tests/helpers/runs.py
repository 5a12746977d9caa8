"""Campaigns on a simulated cell, as the command line runs them, with a look at the controller after the end.

`shared_campaign` runs the shipped sphere campaign once for all workers of a test session, for tests that look at its
end. `child` is a child process of a test, which ends with it.
"""

from __future__ import annotations

import asyncio
import fcntl
import io
import json
import os
import re
import socket
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import chdir, closing, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import pytest

from cellctl.cli.exit_codes import exit_code_of
from cellctl.cli.verbs import app
from cellctl.engine import Mailbox, NobodyWatching, Outcome
from cellctl.journal import RunState, fold, read_journal
from cellctl.operations.campaign import load_campaign
from cellctl.operations.cell_devices import SimulatedCell
from cellctl.operations.launch import Options, run_on

ROOT = Path(__file__).parents[2]
SELFCAL = ROOT / "procedures" / "sphere_selfcal.yaml"
CELL = ROOT / "procedures" / "cells" / "sphere_cell.yaml"
PATIENCE_S = 1700.0
"""Wall time after which a process is taken to hang: long, for a machine may be busy, and less than a test may take."""
UNHURRIED = "  rsi: {timeout_cycles: 1000000}\n"
"""For a cell's `simulate:` section: the controller counts late answers and never stops for them."""
TOUCHES = """
procedure: touches
title: Some touches, nothing identified
steps:
  - id: plan
    do: sphere.plan
    with: {fit: FIT, held_out: 1}
    timeout: 120
  - id: points
    for_each: ${plan.touches}
    as: planned
    steps:
      - id: touch
        do: sphere.touch
        with: {touch: "${planned}", speed_mm_s: 5}
        timeout: 120
        retry: {attempts: 2, on: [NoContact]}
cleanup:
  - {id: hold, do: robot.stop, timeout: 15}
"""

SEED = 1

FASTEST = ("search_speed=10", "transfer_speed=50")
"""The highest speeds that `sphere_selfcal` allows: where a contact is measured does not depend on them, and a search
takes half as many cycles."""


def confirmed_touches(folder: Path, fit: int = 8) -> Path:
    """A procedure that waits for a confirmation, then does `fit` touches and one more, without identification."""
    path = folder / "confirmed_touches.yaml"
    text = TOUCHES.replace("FIT", str(fit)).replace("procedure: touches", f"procedure: confirmed_touches\ncell: {CELL}")
    path.write_text(text.replace("steps:\n", 'steps:\n  - {id: clear, confirm: "Is the cell clear?"}\n', 1))
    return path


def touches_procedure(folder: Path, fit: int = 5, speed_mm_s: float = 5) -> Path:
    """A procedure of `fit` touches and one more, without identification."""
    path = folder / "touches.yaml"
    path.write_text(TOUCHES.replace("FIT", str(fit)).replace("speed_mm_s: 5", f"speed_mm_s: {speed_mm_s}"))
    return path


def copied_cell(
    shipped: Path, folder: Path, simulate: str = "", replace: dict[str, str] | None = None, name: str = "cell.yaml"
) -> Path:
    """A copy of a shipped cell with lines added to its `simulate:` section, and pieces of text replaced."""
    text = shipped.read_text().replace("../robots/", f"{shipped.parents[1]}/robots/")
    text = text.replace("?ethernet=", f"?ethernet={shipped.parent}/")
    text = text.replace("programs: ur10e_programs", f"programs: {shipped.parent}/ur10e_programs")
    for old, new in (replace or {}).items():
        assert old in text, f"the shipped cell has no '{old}'"
        text = text.replace(old, new)
    path = folder / name
    path.write_text(text.rstrip() + "\n" + simulate)
    return path


def cell_with(folder: Path, simulate: str = "", replace: dict[str, str] | None = None) -> Path:
    """A copy of the shipped sphere cell with lines added to its `simulate:` section, and pieces of text replaced."""
    return copied_cell(CELL, folder, simulate, replace)


QUICK_STATION = "edm_s: 0.2, fine_adjust_s: 0.2, lock_s: 0.2, speed_deg_s: 180"
"""Settings of `simulate: tracker:` that change how long a measurement takes, and not what it shows."""


def quick_cell(
    folder: Path,
    simulate: str = "",
    replace: dict[str, str] | None = None,
    *,
    shipped: Path = CELL,
    name: str = "cell.yaml",
) -> Path:
    """As `copied_cell`, and a minute in it costs less: RSI in cycles of 12 ms, a station that measures and turns fast.

    For tests whose subject is none of them. Measured contacts and poses are as good as in the shipped cell, as contacts
    are interpolated between two cycles; only the over-travel after a contact is 1.5 times as long.
    """
    path = copied_cell(shipped, folder, simulate, replace, name)
    text = path.read_text().replace("&eki=", "&cycle=ipo&eki=")
    if "  tracker: {" in text:
        text = text.replace("  tracker: {", f"  tracker: {{{QUICK_STATION}, ")
    elif "  tracker: " in text:
        text += f"  tracker: {{{QUICK_STATION}}}\n"
    path.write_text(text)
    return path


def faults(*settings: str) -> str:
    """Lines of a `simulate:` section with these faults."""
    return "  faults:\n" + "".join(f"    - {{{setting}}}\n" for setting in settings)


@dataclass(frozen=True)
class Ended:
    """A campaign that has ended: how, what its journal holds, the simulator's truth of every contact, and what the
    controller says of itself afterwards: two states, 300 ms of its time apart.
    """

    outcome: Outcome
    journal: RunState
    truth: list[dict[str, Any]]
    states: list[dict[str, str]]

    @property
    def touches(self) -> list[dict[str, Any]]:
        return [dict(row) for row in self.journal.data_of("touch")]

    def robot_is_held(self) -> bool:
        """The controller is neither moving nor under RSI, and the joints do not change."""
        first, last = self.states[0], self.states[-1]
        still = all(abs(float(first[axis]) - float(last[axis])) < 1e-3 for axis in ("A1", "A2", "A3", "A4", "A5", "A6"))
        return still and {first["Prog"], last["Prog"]} <= {"READY", "STOPPED", "ERROR"}


def run_here(
    procedure: Path,
    cell: Path,
    folder: Path,
    *,
    seed: int | None = None,
    clock: Any = None,
    meanwhile: Any = None,
    simulated_cell: Path | None = None,
) -> Ended:
    """Run a campaign in this process on simulators that outlive it; `meanwhile(mailbox, simulated)` is a coroutine
    function that runs beside it. `simulated_cell`: the simulators' cell file, where `cell` is wrong about the cell.
    """

    async def go() -> Ended:
        campaign = load_campaign(procedure, cell, [])
        run, log = folder / "run", folder / "truth.jsonl"
        real = load_campaign(procedure, simulated_cell, []).cell if simulated_cell else campaign.cell
        simulated = await SimulatedCell.start(real, seed, clock, ("--truth-log", str(log)))
        try:
            mailbox = Mailbox()
            options = Options(seed, clock)
            engine = asyncio.create_task(run_on(simulated, campaign, options, run, mailbox, NobodyWatching()))
            if meanwhile:
                await meanwhile(mailbox, simulated)
            outcome = await engine
            eki = str(simulated.address("robot").query["eki"])
            states = await asyncio.to_thread(controller_states, eki)
        finally:
            simulated.stop()
        truth = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
        return Ended(outcome, fold(read_journal(run)), truth, states)

    return asyncio.run(go())


def only_run(runs: Path) -> Path:
    """The run in a folder of runs, which may also hold the history of tables."""
    (journal,) = runs.glob("*/journal.sqlite")
    return journal.parent


def controller_states(eki: str) -> list[dict[str, str]]:
    """Some `Stat` documents of the controller, read by hand."""
    host, _, port = eki.rpartition(":")
    text = ""
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as line:
        while text.count("</Stat>") < 4:
            received = line.recv(4096)
            assert received, "the controller closed the channel"
            text += received.decode()
    return [dict(re.findall(r'(\w+)="([^"]*)"', stat)) for stat in re.findall(r"<Stat .*?</Stat>", text, re.DOTALL)]


def cellctl(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the command line as in a process of its own, from the project's folder; in this one: its imports take long.

    That a process of its own ends with this exit code, output and signals has tests of its own.
    """
    words, texts = [str(word) for word in arguments], [io.TextIOWrapper(io.BytesIO(), "utf-8") for _ in range(2)]
    with chdir(ROOT), redirect_stdout(texts[0]), redirect_stderr(texts[1]):
        code = exit_code_of(lambda: app(words, standalone_mode=False))
    out, err = (_written(text) for text in texts)
    return subprocess.CompletedProcess(words, code, out, err)


def _written(text: io.TextIOWrapper) -> str:
    text.seek(0)
    return text.read()


def cellctl_process(*arguments: str | Path, timeout: float = PATIENCE_S) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own, from the project's folder."""
    command = [sys.executable, "-m", "cellctl", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False, cwd=ROOT)


def finished_run(runs: Path, procedure: str | Path, *arguments: str | Path) -> Path:
    """The run folder of a procedure in the folder `runs`, which is there after the end only; an earlier run serves.

    Raises RuntimeError where the run does not come to a verdict.
    """
    if not runs.exists():
        runs.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=runs.parent) as place:
            done = cellctl("run", procedure, "--runs", Path(place) / "runs", *arguments)
            if done.returncode not in (0, 1):
                raise RuntimeError(f"{runs.name}: {done.stderr}")
            (Path(place) / "runs").rename(runs)
    return next(runs.glob("*/journal.sqlite")).parent


def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take no silence for a loss in real time: on a machine with other things to do each process stalls now and then.

    That the robot is held in such silences has tests of its own, in the cell's time.
    """
    for silence in (
        "drivers.kuka_rsi.robot.lines._OLDEST_ENGINE_BEAT_S",
        "drivers.contact_probe.session._SILENCE_S",
        "procedures.steps.contact_search._PROBE_PATIENCE_S",
    ):
        monkeypatch.setattr(silence, 60.0)


class _OfAnother:
    """Simulators that another process has started: that one sees their end."""

    def wait(self, seconds: float) -> int:
        raise subprocess.TimeoutExpired([], seconds)


def another_engine(ready: dict[str, Any], procedure: Path, cell: Path, folder: Path) -> Outcome:
    """A run into `folder` on a simulated cell of another process, by the content of its ready file."""
    simulated = SimulatedCell(cast("Any", _OfAnother()), cast("Any", None), ready)
    campaign = load_campaign(procedure, cell, [])
    return asyncio.run(run_on(simulated, campaign, Options(None, "realtime"), folder, Mailbox(), NobodyWatching()))


@contextmanager
def busy_machine(processes: int = 2) -> Iterator[None]:
    """Keep the processors busy meanwhile."""
    spin = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in spin:
            process.kill()
            process.wait()


@dataclass(frozen=True)
class Whole:
    """A whole campaign as the command line ran it: its result and its run folder. Not to be changed: others read it."""

    result: dict[str, Any]
    run: Path

    @property
    def journal(self) -> RunState:
        return fold(read_journal(self.run))

    @property
    def truth(self) -> list[dict[str, Any]]:
        """The simulator's truth of every contact."""
        return [json.loads(line) for line in (self.run.parent / "truth.jsonl").read_text().splitlines()]


def campaign(seed: int, folder: Path, *more: str | Path, shipped: Path = CELL) -> Whole:
    """The shipped campaign in a quick cell, at the highest speeds, on the robot of that seed: better than nominal."""
    truth = ("--simulator=--truth-log", f"--simulator={folder / 'truth.jsonl'}")
    result, cell = folder / "result.json", quick_cell(folder, shipped=shipped)
    given = ("--cell", cell, "--seed", str(seed), *(f"--set={setting}" for setting in FASTEST), *truth, *more)
    done = cellctl("run", SELFCAL, "--runs", folder, "--json", result, *given)
    assert done.returncode == 0, done.stderr
    return _read(folder)


def shared_campaign(factory: pytest.TempPathFactory) -> Whole:
    """The campaign of SEED: the first test that asks runs it, those of other workers wait for it."""
    session = factory.getbasetemp()
    session = session.parent if "PYTEST_XDIST_WORKER" in os.environ else session
    folder = session / "shared_campaign"
    with (session / "shared_campaign.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "ended").exists():
            folder.mkdir(exist_ok=True)
            campaign(SEED, folder)
            (folder / "ended").touch()
        return _read(folder)


def _read(folder: Path) -> Whole:
    result = json.loads((folder / "result.json").read_text())
    return Whole(result, folder / result["run"])


@contextmanager
def child(command: Sequence[str | Path], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A `Popen` of `command`, killed where the block leaves it running: the `with` of a Popen would wait for its end,
    so a test that failed would hang, with an engine and its simulators at full load."""
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            process.kill()


def edited(journal: Path, statement: str) -> None:
    """Change the file of a journal as somebody might afterwards, past its triggers."""
    with closing(sqlite3.connect(journal)) as connection:
        for trigger in ("events_are_not_changed", "events_are_not_removed"):
            connection.execute(f"DROP TRIGGER IF EXISTS {trigger}")
        connection.execute(statement)
        connection.commit()
