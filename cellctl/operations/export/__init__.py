"""Exports a run for other programs: samples, events, bluesky documents, pictures, a certificate, or all in one zip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, final

from cellctl.files import InputError, Problem
from cellctl.journal import JournalError, ReadableJournal, RunState, fold, is_being_written, journal_in
from cellctl.operations.export import archive, events, samples
from cellctl.operations.export.certificate import certificate
from cellctl.report import report_pictures, report_text


@final
class Form(StrEnum):
    """The forms of an export."""

    CSV = "csv"
    PARQUET = "parquet"
    JSONL = "jsonl"
    BLUESKY = "bluesky"
    FIGURES = "figures"
    DCC = "dcc"
    ZIP = "zip"

    @property
    def file_name(self) -> str:
        """The end of an export's file name: `samples.csv`."""
        return {
            Form.CSV: "samples.csv",
            Form.PARQUET: "samples.parquet",
            Form.JSONL: "events.jsonl",
            Form.BLUESKY: "bluesky.jsonl",
            Form.FIGURES: "figures.zip",
            Form.DCC: "certificate.xml",
            Form.ZIP: "run.zip",
        }[self]


@final
@dataclass(frozen=True, slots=True)
class Exported:
    """An export: its content, the number of samples and of events, and what could not be exported, as text."""

    content: bytes
    samples: int
    events: int
    missing: tuple[str, ...]

    def refuse_missing(self, run: Path, out: Path) -> None:
        """Raise InputError, after the file is written, with everything that it lacks."""
        if self.missing:
            note = f"everything else is in {out}; restore the run folder from a copy for the rest"
            raise InputError([Problem(str(run), 0, 0, each) for each in self.missing], note)


def export_run(place: Path, form: Form, facts: Mapping[str, Any] | None = None) -> Exported:
    """Export the run in `place` (its folder or its journal): also one that is running, was aborted, or is damaged.

    facts: fields of the cell file's `report:` to replace, for a certificate.

    Raises JournalError if no event can be read (a zip then holds the other files), InputError for Parquet without
    pyarrow, for bluesky documents without the run's first event, and for a certificate that would be incomplete.
    """
    try:
        journal = ReadableJournal.of(place)
    except JournalError as error:
        if form is not Form.ZIP or not place.exists():
            raise
        return _of_unreadable(place, error)
    return _Export(place, journal, facts or {}).exported(form)


def _of_unreadable(place: Path, error: JournalError) -> Exported:
    files = archive.Archive()
    archive.add_run_files(files, place, RunState())
    files.missing.append(f"exports: {error.what}")
    name = journal_in(place).parent.resolve().name
    content = files.to_bytes(lambda found: archive.readme(name, found, None, files.missing))
    return Exported(content, 0, 0, tuple(files.missing))


@final
class _Export:
    """The export of a run with a readable journal."""

    def __init__(self, place: Path, journal: ReadableJournal, facts: Mapping[str, Any]) -> None:
        self._place, self._journal, self._facts = place, journal, facts
        self._state = fold(journal.entries)
        self._name = self._state.name or journal_in(place).parent.resolve().name
        self._samples = samples.Samples.of(self._state.rows, self._state)

    def exported(self, form: Form) -> Exported:
        missing = list(self._journal.damage)
        content = self._content(form, missing)
        return Exported(content, self._samples.count, len(self._journal.entries), tuple(missing))

    def _content(self, form: Form, missing: list[str]) -> bytes:
        match form:
            case Form.CSV:
                return self._samples.to_csv().encode()
            case Form.PARQUET:
                return self._parquet()
            case Form.JSONL:
                return events.event_lines(self._journal).encode()
            case Form.BLUESKY:
                return self._bluesky().encode()
            case Form.FIGURES:
                return self._figures(missing)
            case Form.DCC:
                return certificate(self._place, self._facts)
            case Form.ZIP:
                return self._zip(missing)

    def _parquet(self) -> bytes:
        return samples.parquet(self._samples, self._name)

    def _bluesky(self) -> str:
        alive = is_being_written(self._place)
        return events.bluesky(self._name, self._journal.entries, self._state, alive=alive)

    def _figures(self, missing: list[str]) -> bytes:
        files = archive.Archive()
        try:
            for picture in report_pictures(self._place):
                files.add(f"{picture.name}.svg", picture.alt, picture.svg)
                files.add(f"{picture.name}.png", picture.alt, picture.png)
        except JournalError as error:
            missing.append(f"figures: {error.what}")
        return files.to_bytes(lambda found: archive.readme(self._name, found, None, missing))

    def _zip(self, missing: list[str]) -> bytes:
        files = archive.Archive()
        archive.add_run_files(files, self._place, self._state)
        archive.add_exports(files, self._journal, self._samples)
        what = "samples as documents of bluesky's event model, one [name, document] per line; times in s (Unix)"
        files.add_tried("exports/bluesky.jsonl", what, self._bluesky)
        if samples.installed():
            files.add_tried("exports/samples.parquet", "exports/samples.csv as Parquet", self._parquet)
        if not (journal_in(self._place).parent / "report.html").is_file():
            files.add_tried("report.html", "calibration report so far; prints on A4", self._report)
        missing += files.missing
        return files.to_bytes(lambda found: archive.readme(self._name, found, self._samples, missing))

    def _report(self) -> str:
        return report_text(self._place)
