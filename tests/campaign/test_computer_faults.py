"""A full disk, a folder that cannot be written, two engines on one cell, simulators killed: each a clear end."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest

from cellctl.devices import DeviceError, DeviceUnreachable
from cellctl.engine import Mailbox, NobodyWatching, State
from cellctl.journal import fold, read_journal
from cellctl.operations.campaign import load_campaign
from cellctl.operations.cell_devices import SimulatedCell
from cellctl.operations.launch import Options, run_on
from tests.helpers.runs import (
    PATIENCE_S,
    ROOT,
    UNHURRIED,
    another_engine,
    cell_with,
    cellctl,
    child,
    controller_states,
    only_run,
    touches_procedure,
    unhurried,
)

pytestmark = pytest.mark.campaign


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 220 KiB, where this machine allows one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=220k", "tmpfs", str(disk)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("this machine lets nobody mount a small file system")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.long
def test_a_disk_that_fills_up_ends_the_run_and_what_was_committed_is_kept(small_disk: Path, tmp_path: Path) -> None:
    arguments = ["run", touches_procedure(tmp_path), "--cell", cell_with(tmp_path), "--runs", small_disk]
    done = cellctl(*arguments)
    assert done.returncode == 3, done.stderr
    assert "the disk is full" in done.stderr
    assert "the robot is held" in done.stderr
    assert "Traceback" not in done.stderr
    state = fold(read_journal(only_run(small_disk)))
    assert state.started is not None
    assert state.steps["plan"].outcome == "done"


def test_a_folder_that_cannot_hold_a_run_is_refused_before_anything_moves(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.write_text("a file where a folder should be")
    done = cellctl("run", touches_procedure(tmp_path), "--cell", cell_with(tmp_path), "--runs", runs)
    assert done.returncode == 2
    assert "cannot hold a run" in done.stderr
    assert "--runs" in done.stderr


def test_a_result_that_could_not_be_written_is_refused_before_anything_moves(tmp_path: Path) -> None:
    common = ["run", touches_procedure(tmp_path), "--cell", cell_with(tmp_path), "--runs", tmp_path / "runs"]
    done = cellctl(*common, "--json", tmp_path / "nowhere" / "result.json")
    assert done.returncode == 2
    assert "--json" in done.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.long
def test_a_second_engine_on_a_cell_is_turned_away_and_the_first_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unhurried(monkeypatch)
    procedure, cell = touches_procedure(tmp_path), cell_with(tmp_path, UNHURRIED)

    async def two() -> tuple[Any, Any]:
        campaign = load_campaign(procedure, cell, [])
        simulated = await SimulatedCell.start(campaign.cell, None, "realtime")
        try:
            options = Options(None, "realtime")
            watch = NobodyWatching()
            first_engine = asyncio.create_task(
                run_on(simulated, campaign, options, tmp_path / "first", Mailbox(), watch)
            )
            while not _touches(tmp_path / "first") and not first_engine.done():
                await asyncio.sleep(0.1)
            arguments = (simulated.ready, procedure, cell, tmp_path / "second")
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:  # its start must not stall the first
                second = await asyncio.get_running_loop().run_in_executor(pool, another_engine, *arguments)
            return await first_engine, second
        finally:
            simulated.stop()

    first, second = asyncio.run(two())
    assert second.state in (State.FAILED, State.UNCERTAIN)
    assert isinstance(second.error, DeviceError)
    assert not fold(read_journal(tmp_path / "second")).steps.keys() & {"plan"}
    assert first.state is State.FINISHED
    assert len(_touches(tmp_path / "first")) == 6


@pytest.mark.long
def test_simulators_killed_in_mid_campaign_are_a_lost_cell_and_nothing_recorded_is_lost(tmp_path: Path) -> None:
    cell, runs = cell_with(tmp_path), tmp_path / "runs"
    procedure = touches_procedure(tmp_path, fit=60)  # so many that it is not over before it is seen to be under way
    command = [sys.executable, "-m", "cellctl", "run", str(procedure), "--cell", str(cell)]
    with child([*command, "--runs", str(runs)], stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
        # with a third one recorded, at least two have come to their end
        while process.poll() is None and not any(len(_touches(run)) >= 3 for run in runs.glob("*")):
            time.sleep(0.05)  # noqa: TID251 - another process, in wall time
        os.kill(_simulator_of(cell), signal.SIGKILL)
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 4, said
    assert "may still be moving" in said
    assert "the simulated cell ended by signal 9" in said
    assert "Traceback" not in said
    state = fold(read_journal(only_run(runs)))
    assert state.state == "uncertain"
    assert len(state.data_of("touch")) >= 2
    assert not state.in_flight


def test_simulators_that_never_get_ready_are_unreachable_and_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = load_campaign(touches_procedure(tmp_path), cell_with(tmp_path), [])
    monkeypatch.setattr("cellctl.operations.cell_devices.simulator_command", lambda *_: ["sleep", "600"])
    monkeypatch.setattr("cellctl.operations.cell_devices._START_SECONDS", 0.1)
    with pytest.raises(DeviceUnreachable, match=r"simulator: was not ready within 0\.1 s"):
        asyncio.run(SimulatedCell.start(campaign.cell, None, None))


@pytest.mark.long
def test_after_the_end_the_controller_can_be_asked_again(tmp_path: Path) -> None:
    async def one() -> list[dict[str, str]]:
        campaign = load_campaign(touches_procedure(tmp_path), cell_with(tmp_path), [])
        simulated = await SimulatedCell.start(campaign.cell, None, "lockstep")
        try:
            ended = await run_on(
                simulated, campaign, Options(None, None), tmp_path / "run", Mailbox(), NobodyWatching()
            )
            assert ended.state is State.FINISHED
            return await asyncio.to_thread(controller_states, str(simulated.address("robot").query["eki"]))
        finally:
            simulated.stop()

    assert asyncio.run(one())[-1]["Prog"] in ("READY", "STOPPED")


def _touches(run: Path) -> list[Any]:
    return list(fold(read_journal(run)).data_of("touch")) if (run / "journal.sqlite").exists() else []


def _simulator_of(cell: Path) -> int:
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"sims" in words and str(cell).encode() in words:
            return int(process.name)
    raise AssertionError("no simulator of this cell runs")
