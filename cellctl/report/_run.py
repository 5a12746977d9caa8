"""A run from its folder: the journal, and data set, model and table if they exist."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, TypeVar, final

from cellctl.devices.cell import AcceptanceCriterion, ReportFacts
from cellctl.files import Document, InputError, parse_yaml, sha256_of
from cellctl.files.validated import validated
from cellctl.formats import Artefact, DataSet, ModelFile, artefact_of
from cellctl.journal import JournalCheck, RunState, check_journal, fold, is_being_written, journal_in, read_journal
from cellctl.records import VerdictRow

Found = TypeVar("Found")


@final
@dataclass(frozen=True)
class Run:
    """The data of a run.

    cell, artefact: from the cell's text in the journal. table: the table file's content. hashes: SHA-256 of the files
    beside the journal. verdict: the last; None if the run has none. facts: the cell file's `report:`. criteria: its
    `acceptance:`. journal: what its digests say. complaints: unreadable and inconsistent files, changes of the journal,
    as text.
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
    verdict: VerdictRow | None
    facts: ReportFacts
    journal: JournalCheck
    criteria: tuple[AcceptanceCriterion, ...]
    complaints: tuple[str, ...]

    @classmethod
    def load(cls, place: Path) -> Self:
        """The run in folder `place` (or with the journal `place`). Raises JournalError if that cannot be read.

        Any other unreadable file is a complaint: the report shows the rest.
        """
        folder = journal_in(place).parent
        state = fold(read_journal(place))
        complaints: list[str] = []
        cell = _tried(lambda: _cell(state), complaints)
        run = cls(
            folder=folder,
            state=state,
            alive=is_being_written(folder),
            cell=cell,
            artefact=_tried(lambda: _artefact(cell), complaints),
            data=_tried(lambda: _if_there(folder / "dataset.csv", DataSet.load), complaints),
            model=_tried(lambda: _if_there(folder / "model.json", ModelFile.load), complaints),
            table=_tried(lambda: _if_there(folder / "table.json", _table), complaints),
            hashes=_hashes(folder),
            verdict=_tried(lambda: state.last(VerdictRow), complaints),
            facts=_tried(lambda: _facts(cell), complaints) or ReportFacts(),
            journal=check_journal(place),
            criteria=_tried(lambda: _criteria(cell), complaints) or (),
            complaints=(),
        )
        changed = (f"the journal was changed after the run: {text}" for text in run.journal.changed)
        return replace(run, complaints=(*changed, *complaints, *_mismatches(run)))

    def with_facts(self, facts: Mapping[str, Any]) -> Self:
        """The run with these fields of its `facts` replaced."""
        return replace(self, facts=self.facts.model_copy(update=dict(facts)))

    @property
    def criterion(self) -> AcceptanceCriterion | None:
        """The first that is for this procedure and robot, with the limit of the `facts` if they have one."""
        started, serial = self.state.started, str(self.state.identities.get("robot", {}).get("serial", ""))
        procedure = Path(started.procedure.path).stem if started else ""
        limit = self.facts.limit_mm
        for each in self.criteria:
            if each.procedure in ("", procedure) and each.robot in ("", serial):
                return each if limit is None else each.model_copy(update={"limit_mm": limit})
        return None if limit is None else AcceptanceCriterion(limit_mm=limit)

    @property
    def name(self) -> str:
        """The run's name."""
        return self.state.name or self.folder.resolve().name

    @property
    def title(self) -> str:
        """The title of its procedure."""
        if self.state.started is None:
            return "A run that never began"
        for line in self.state.started.procedure.text.splitlines():
            if line.startswith("title:"):
                return line.removeprefix("title:").strip().strip("\"'")
        return self.state.started.procedure.path

    @property
    def reason(self) -> str:
        """Why it ended, if it did not finish; else empty."""
        return self.state.ended.reason if self.state.ended else ""

    @property
    def figures(self) -> Mapping[str, Any]:
        """The fit's report: from the verdict, or from the model file if the run ended before its verdict."""
        if self.verdict is not None and self.verdict.model is not None:
            return self.verdict.model
        return self.model.figures if self.model else {}

    @property
    def simulated(self) -> bool:
        """Whether any device reported that it is simulated, or the cell file has simulation settings."""
        told = any(who.get("simulated") for who in self.state.identities.values())
        return told or (self.cell is not None and isinstance(self.cell.data, dict) and "simulate" in self.cell.data)

    @property
    def word(self) -> str:
        """The run's state in one or two words."""
        still = self.alive and self.state.ended is None
        return "still running" if still else self.state.state_if(running=self.alive)


def _cell(state: RunState) -> Document | None:
    return parse_yaml(state.started.cell.text, state.started.cell.path) if state.started else None


def _facts(cell: Document | None) -> ReportFacts | None:
    there = cell is not None and isinstance(cell.data, dict) and cell.data.get("report")
    return validated(cell, ReportFacts, ("report",)) if cell is not None and there else None


def _criteria(cell: Document | None) -> tuple[AcceptanceCriterion, ...] | None:
    there = cell is not None and isinstance(cell.data, dict) and cell.data.get("acceptance")
    if cell is None or not isinstance(there, list):
        return None
    return tuple(validated(cell, AcceptanceCriterion, ("acceptance", index)) for index in range(len(there)))


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


def _mismatches(run: Run) -> list[str]:
    """Files in the folder that differ from the model's sources."""
    if run.model is None:
        return []
    of_model, found = run.model.provenance, []
    data = of_model.get("data_sha256")
    if data and run.hashes.get("dataset.csv") not in (None, data):
        found.append("dataset.csv is not the file that the model was made from")
    cell = of_model.get("cell_sha256")
    if cell and run.state.started is not None and run.state.started.cell.sha256 != cell:
        found.append("the model was made with another cell file than the run's")
    return found
