"""What a step sees of a run, without an engine: rows that all count, what it said, and who the devices are."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cellctl.clock import Clock, WallClock
from cellctl.devices import Identity
from cellctl.files import write_atomically
from cellctl.records import Row


@dataclass
class Context:
    """A step's view of a run in which every row counts."""

    rows: list[Row] = field(default_factory=list)
    run_folder: Path = Path()
    robot: Any = None
    serial: str = "SIM-1"
    run_name: str = "run"
    operator: str = "Ada"
    robot_file: Path = Path()
    cell: Any = None
    said: list[str] = field(default_factory=list)
    clock: Clock = field(default_factory=WallClock)

    def device(self, name: str) -> Any:
        return self.robot

    def identity(self, name: str) -> Identity:
        return Identity(name, self.serial, "KR5", "KSS", self.serial.startswith("SIM-"))

    async def record(self, row: Row) -> None:
        self.rows.append(row)

    async def write_artefact(self, name: str, content: str) -> None:
        write_atomically(self.run_folder / name, content)

    def artefact(self, name: str) -> Path:
        return self.run_folder / name

    def recorded(self, *kinds: type[Row]) -> list[Any]:
        of = {kind.KIND: kind for kind in kinds}
        return [of[row.KIND].read(row.data()) for row in self.rows if row.KIND in of]

    all_recorded = recorded

    def say(self, text: str) -> None:
        self.said.append(text)
