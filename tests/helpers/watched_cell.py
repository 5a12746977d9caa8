"""A simulated cell in a thread of the test, with the true joints of its robot kept in every cycle of the controller."""

from __future__ import annotations

import itertools
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any, final
from unittest.mock import patch

import sims.running
from cellctl.operations.cell_devices import SimulatedCell
from sims.cell import read_cell
from sims.running import RunningCell
from tests.helpers.corrected_cells import Bench, robot_of

CYCLE_NS = 4_000_000
PATIENCE_S = 60.0
_STANDS_CYCLES = 75


@final
class WatchedCell:
    """`joints`: the robot's true joints, deg, one row each `CYCLE_NS` of the cell's time."""

    def __init__(self, cell_file: Path) -> None:
        scenes: list[Any] = []

        def keep(*arguments: Any, **named: Any) -> Any:
            scenes.append(_SCENE(*arguments, **named))
            return scenes[-1]

        with patch.object(sims.running, "Scene", keep):
            self.cell = RunningCell(read_cell(cell_file), wait_for_host=True)
        (self._scene,) = scenes
        self.joints: list[tuple[float, ...]] = []
        self._keep()
        self._thread = threading.Thread(target=self.cell.run, daemon=True)
        self._thread.start()

    def seen_from(self) -> SimulatedCell:
        """As the drivers of a cell address it."""
        return SimulatedCell(None, None, self.cell.ready)  # type: ignore[arg-type] - no process of its own

    def let_pass(self, seconds: float) -> None:
        """Until so much of the cell's time has gone by."""
        passed = threading.Event()
        self.cell.kernel.at(self.cell.kernel.now + round(seconds * 1e9), passed.set)
        assert passed.wait(PATIENCE_S)

    def close(self) -> None:
        self.cell.kernel.stop()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        self.cell.close()

    def largest_step(self) -> float:
        """Of any axis from one cycle to the next, deg."""
        pairs = itertools.pairwise(self.joints)
        return max(abs(b - a) for before, after in pairs for a, b in zip(before, after, strict=True))

    def held(self) -> bool:
        """Whether the robot has stood for the last 0.3 s."""
        last = self.joints[-_STANDS_CYCLES:]
        return len(set(last)) == 1

    def _keep(self) -> None:
        kernel = self.cell.kernel
        self.joints.append(tuple(self._scene.arm.joints_at(kernel.now)[0]))
        kernel.at(kernel.now + CYCLE_NS, self._keep)


_SCENE = sims.running.Scene


@contextmanager
def watched_cell(cell_file: Path) -> Iterator[WatchedCell]:
    """The simulators of a cell file in lockstep."""
    watched = WatchedCell(cell_file)
    try:
        yield watched
    finally:
        watched.close()


@asynccontextmanager
async def watched_robot(cell_file: Path) -> AsyncIterator[tuple[Bench, WatchedCell]]:
    """The robot of a cell file, connected to simulators that are watched."""
    with watched_cell(cell_file) as watched:
        async with robot_of(cell_file, watched.seen_from()) as bench:
            yield bench, watched
