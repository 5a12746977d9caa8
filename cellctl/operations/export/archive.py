"""One zip with everything of a run: its files, its sources, its exports, and a README that names each with units."""

from __future__ import annotations

import io
import sqlite3
import zipfile
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Final, final

from cellctl.files import InputError, sha256_of
from cellctl.journal import JournalError, ReadableJournal, RunState, journal_in
from cellctl.operations.export.events import event_lines
from cellctl.operations.export.samples import Samples
from cellctl.records import ArtefactRow

_KNOWN: Final = {
    "dataset.csv": "data set of the identification: joints in degrees, lengths in mm (docs/reference/data-sets.md)",
    "model.json": "identified robot with covariance: lengths in mm, angles in rad (docs/reference/fit.md)",
    "table.json": "compensation table: joints in degrees, errors in mm (docs/reference/table-files.md)",
    "tool.yaml": "tool: lengths in mm (docs/measuring.md)",
    "report.html": "calibration report; prints on A4",
    "simulated_cell.json": "state of the simulated cell at the end of the run",
}
_JOURNAL: Final = "every event of the run (docs/reference/run-folder.md): SQLite, times in ns of the cell's time"
_SAMPLES: Final = "a row for each measured sample; units of the columns: see below"


@final
class Archive:
    """Collects files with a line of description each, and what is missing."""

    def __init__(self) -> None:
        self.missing: list[str] = []
        self._files: dict[str, tuple[str, bytes]] = {}

    def add(self, name: str, what: str, content: str | bytes) -> None:
        """Add a file."""
        self._files[name] = (what, content.encode() if isinstance(content, str) else content)

    def add_tried(self, name: str, what: str, make: Callable[[], str | bytes]) -> None:
        """Add a file, or state why it cannot be made."""
        try:
            self.add(name, what, make())
        except (InputError, JournalError, OSError, ValueError) as error:
            self.missing.append(f"{name}: {' '.join(str(error).split())}")

    def to_bytes(self, readme: Callable[[Mapping[str, str]], str]) -> bytes:
        """The zip; the same files give the same bytes. readme: its text, from the description of each file."""
        self.add("README.txt", "", readme({name: what for name, (what, _) in self._files.items()}))
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, (_, content) in sorted(self._files.items()):
                entry = zipfile.ZipInfo(name)  # dated 1980: the content alone decides the bytes
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, content)
        return stream.getvalue()


def add_run_files(archive: Archive, place: Path, state: RunState) -> None:
    """The journal, the files that the run made, and its sources as the journal has them."""
    folder = journal_in(place).parent
    archive.add_tried("journal.sqlite", _JOURNAL, lambda: _journal_bytes(journal_in(place)))
    made = {Path(row.name).name: row.sha256 for row in _artefacts(archive, state)}
    for name in dict.fromkeys([*_KNOWN, *made]):
        if (path := folder / name).is_file():
            archive.add_tried(name, _KNOWN.get(name, "made by a step of the run"), path.read_bytes)
            if made.get(name, "") not in ("", sha256_of(path.read_bytes())):
                archive.missing.append(f"{name}: it is here as it is now; it was changed after the run made it")
        elif name in made:
            archive.missing.append(f"{name}: it is no longer in the run folder")
    if state.started is not None:
        sources = {"procedure": state.started.procedure, "cell": state.started.cell, "robot": state.started.robot}
        for name, source in sources.items():
            if source is not None:
                archive.add(f"sources/{name}.yaml", f"{name} file at the start of the run ({source.path})", source.text)


def add_exports(archive: Archive, journal: ReadableJournal, samples: Samples) -> None:
    """The samples and the events."""
    archive.add("exports/samples.csv", _SAMPLES, samples.to_csv())
    what = "the events of the journal, one JSON object per line; time_ns: ns of the cell's time"
    archive.add("exports/events.jsonl", what, event_lines(journal))


def readme(run: str, files: Mapping[str, str], samples: Samples | None, missing: list[str]) -> str:
    """The text of README.txt."""
    width = max(map(len, files), default=0)
    lines = [
        f"Run {run}, exported by cellctl.",
        "",
        "Files",
        *(f"  {n:{width}}  {w}" for n, w in sorted(files.items())),
    ]
    if samples is not None:
        wide = max(len(column.name) for column in samples.columns)
        lines += ["", "Columns of the samples, with units"]
        lines += [f"  {column.name:{wide}}  {column.unit or '-'}" for column in samples.columns]
        lines += [
            "  Joints are the controller's readings. Points are in the frame of the instrument that measured them."
        ]
        lines += ["  counts is false for samples of failed or repeated attempts."]
    if missing:
        lines += ["", "Missing or changed", *(f"  {each}" for each in missing)]
    return "\n".join([*lines, ""])


def _artefacts(archive: Archive, state: RunState) -> list[ArtefactRow]:
    try:
        return state.recorded(ArtefactRow)
    except InputError as error:
        archive.missing.append(str(error))
        return []


def _journal_bytes(path: Path) -> bytes:
    """The journal at one instant, also while it is written; the bytes of the file where SQLite cannot read it."""
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
            return connection.serialize()
    except sqlite3.Error:
        return path.read_bytes()
