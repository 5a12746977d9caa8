"""The audit log: every command that the console took, with who, when and how it ended."""

from __future__ import annotations

import json
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from cellctl.clock import calendar_time
from cellctl.engine import Operator
from cellctl.files.writing import append_line

FILE_NAME = "audit.jsonl"


@final
@dataclass(frozen=True, slots=True)
class Audit:
    """The file `audit.jsonl` of a folder of runs: one JSON object for each line, two lines for each command.

    The first line is durable before the command begins, the second states its outcome: a command without a second
    line was cut off.
    """

    folder: Path

    def asked(self, operator: Operator, command: str, target: str, details: dict[str, Any]) -> str:
        """Record that `operator` gave `command` for `target` (a run, a cell, a table); its id. Raises OSError."""
        number = secrets.token_hex(8)
        self._append(
            {
                "id": number,
                "time": calendar_time(),
                "command": command,
                "target": target,
                "operator": operator.name,
                "host": operator.host,
                "via": operator.via,
                **({"details": details} if details else {}),
            }
        )
        return number

    def ended(self, number: str, refused: str = "") -> None:
        """Record how the command `number` ended; `refused`: why it failed, empty if it was done. Raises OSError."""
        outcome = {"outcome": "failed", "reason": refused} if refused else {"outcome": "done"}
        self._append({"id": number, "time": calendar_time(), **outcome})

    def read(self, last: int = 200) -> list[dict[str, Any]]:
        """The newest `last` commands, newest first, each with its outcome (`cut off` if it has none)."""
        path = self.folder / FILE_NAME
        commands: dict[str, dict[str, Any]] = {}
        for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
            try:
                data = json.loads(line)
                number = data["id"]
            except (ValueError, TypeError, KeyError):
                continue  # the part of a line that a full disk left
            known = commands.setdefault(number, {"outcome": "cut off"})
            known.update(
                {**data, "ended": data["time"], "time": known["time"]}
                if "outcome" in data and "time" in known
                else data
            )
        return list(reversed(commands.values()))[:last]

    def _append(self, data: dict[str, Any]) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        append_line(self.folder / FILE_NAME, json.dumps(data, ensure_ascii=False))
