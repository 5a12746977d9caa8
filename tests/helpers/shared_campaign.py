"""The shipped sphere campaign, run once for all workers of a test session: for tests that look at its end."""

from __future__ import annotations

import fcntl
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from cellctl.journal import RunState, fold, read_journal
from tests.helpers.runs import SELFCAL, cellctl

SEED = 1


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


def campaign(seed: int, folder: Path, *more: str | Path) -> Whole:
    """The shipped campaign on the robot of that seed, which ends better than nominal."""
    truth = ("--simulator=--truth-log", f"--simulator={folder / 'truth.jsonl'}")
    result = folder / "result.json"
    done = cellctl("run", SELFCAL, "--seed", str(seed), "--runs", folder, "--json", result, *truth, *more)
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
