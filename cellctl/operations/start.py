"""A complete run: started in a new folder or resumed, then executed."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from cellctl.devices import DeviceBusy
from cellctl.engine import Outcome, Watcher
from cellctl.journal import RunResult
from cellctl.operations.campaign import Campaign
from cellctl.operations.launch import Options, run_campaign
from cellctl.operations.results import new_run_folder, result_of, table_line
from cellctl.operations.resume import resumed_run


@final
@dataclass(frozen=True, slots=True)
class PreparedRun:
    """A run that is ready to begin: its campaign, its folder, and its settings."""

    campaign: Campaign
    folder: Path
    options: Options

    @property
    def table(self) -> str:
        """State of the table that a resumed run pushed before; empty if it pushed none."""
        return table_line(self.options.resumed, self.folder) if self.options.resumed else ""

    def carry_out(self, watcher: Watcher) -> tuple[Outcome, RunResult]:
        """Run it to its end; returns its outcome and its result. Raises what `run_campaign` raises."""
        began = time.monotonic()
        try:
            outcome = asyncio.run(run_campaign(self.campaign, self.options, self.folder, watcher))
        except DeviceBusy:
            with suppress(OSError):  # nothing was begun: the folder of a new run is empty
                self.folder.rmdir()
            raise
        return outcome, result_of(self.folder, outcome, time.monotonic() - began)


def new_run(campaign: Campaign, runs: Path, options: Options) -> PreparedRun:
    """A new run of `campaign`, its folder made in `runs`. Raises InputError if it cannot be made."""
    return PreparedRun(campaign, new_run_folder(runs, campaign.procedure.name), options)


def run_to_resume(campaign: Campaign, runs: Path, run: Path, settings: list[str], options: Options) -> PreparedRun:
    """The run in folder `run` (or `runs`/`run`), to resume as it was begun. Raises what `resumed_run` raises."""
    found = resumed_run(campaign, runs, run, settings, acknowledged=options.acknowledged)
    options = replace(options, seed=found.seed, clock=found.clock, resumed=found.state)
    return PreparedRun(found.campaign, found.folder, options)
