"""The row of a file that a step made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

from cellctl.records.row import Row


@final
@dataclass(frozen=True)
class ArtefactRow(Row):
    """A file in the run folder (data set, model, table): its name, SHA-256 (hex) and size in bytes."""

    KIND: ClassVar[str] = "artefact"
    name: str
    sha256: str
    size: int
