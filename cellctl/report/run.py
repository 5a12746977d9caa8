"""A run as its folder tells it: the journal, and beside it data set, model and table where they exist."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar, final

from cellctl.files import Document, InputError, parse_yaml, sha256_of
from cellctl.formats import Artefact, DataSet, ModelFile, artefact_of
from cellctl.journal import RunState, fold, is_being_written, journal_in, read_journal

Found = TypeVar("Found")


@final
@dataclass(frozen=True)
class Run:
    """What there is of a run.

    cell, artefact: as the journal holds the cell's text. table: the table file's content. hashes: SHA-256 of the files
    beside the journal. complaints: files that are there and cannot be read, in words.
    """

    folder: Path
    state: RunState
    alive: bool
    cell: Document | None
    artefact: Artefact | None
    data: DataSet | None
    model: ModelFile | None
    table: Mapping[str, Any] | None
    hashes: Mapping[str, str]
    complaints: tuple[str, ...]

    @classmethod
    def load(cls, place: Path) -> Self:
        """The run in folder `place` (or with the journal `place`). Raises JournalError where that cannot be read.

        Any other file that cannot be read is a complaint: the report shows what there is.
        """
        folder = journal_in(place).parent
        state = fold(read_journal(place))
        complaints: list[str] = []
        cell = _tried(lambda: _cell(state), complaints)
        return cls(
            folder=folder,
            state=state,
            alive=is_being_written(folder),
            cell=cell,
            artefact=_tried(lambda: _artefact(cell), complaints),
            data=_tried(lambda: _if_there(folder / "dataset.csv", DataSet.load), complaints),
            model=_tried(lambda: _if_there(folder / "model.json", ModelFile.load), complaints),
            table=_tried(lambda: _if_there(folder / "table.json", _table), complaints),
            hashes=_hashes(folder),
            complaints=tuple(complaints),
        )

    @property
    def verdict(self) -> Mapping[str, Any]:
        """The last verdict; empty where the run never got to one."""
        return next(reversed(self.recorded("verdict")), {})

    @property
    def figures(self) -> Mapping[str, Any]:
        """What the fit said of itself: the verdict's, or the model file's where the run ended before its verdict."""
        of_verdict = self.verdict.get("model")
        return of_verdict if isinstance(of_verdict, Mapping) else self.model.figures if self.model else {}

    @property
    def simulated(self) -> bool:
        """Whether any of its devices said that it is simulated, or the cell file says how to simulate them."""
        told = any(who.get("simulated") for who in self.state.identities.values())
        return told or (self.cell is not None and isinstance(self.cell.data, dict) and "simulate" in self.cell.data)

    @property
    def word(self) -> str:
        """The run's state in a word or two."""
        if self.state.ended is not None:
            return self.state.state
        return "still running" if self.alive else f"cut off while {self.state.state}"

    def recorded(self, kind: str) -> list[Mapping[str, Any]]:
        """The journal's rows of `kind` that count, as it holds them."""
        return self.state.data_of(kind)


def _cell(state: RunState) -> Document | None:
    return parse_yaml(state.started.cell.text, state.started.cell.path) if state.started else None


def _artefact(cell: Document | None) -> Artefact | None:
    there = cell is not None and isinstance(cell.data, dict) and cell.data.get("artefact")
    return artefact_of(cell, ("artefact",)) if cell is not None and there else None


def _table(path: Path) -> Mapping[str, Any]:
    content = json.loads(path.read_bytes())
    if not isinstance(content, dict):
        raise ValueError(f"{path.name} is no table file")
    return content


def _if_there(path: Path, load: Callable[[Path], Found]) -> Found | None:
    return load(path) if path.exists() else None


def _tried(load: Callable[[], Found | None], complaints: list[str]) -> Found | None:
    try:
        return load()
    except (InputError, OSError, ValueError) as error:
        complaints.append(str(error))
        return None


def _hashes(folder: Path) -> dict[str, str]:
    files = (folder / name for name in ("dataset.csv", "model.json", "table.json"))
    return {file.name: sha256_of(file.read_bytes()) for file in files if file.is_file()}
