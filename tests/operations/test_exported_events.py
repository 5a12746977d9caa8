"""A small journal as JSON lines, as documents with Unix times, and as an archive that says what it lacks."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from cellctl.files import InputError, sha256_of
from cellctl.journal import Journal, KnownEvent, ReadableJournal, Recorded, RunResumed, RunStarted, SourceFile, fold
from cellctl.operations.export.archive import Archive, add_run_files
from cellctl.operations.export.events import documents, event_lines
from cellctl.operations.worker_operations import export

STARTED = RunStarted(
    SourceFile("small.yaml", "procedure: small\n", ""), SourceFile("cell.yaml", "name: a cell\n", ""),
    {"n": 2}, 7, "lockstep", "kai", "2026-11-21T20:30:02Z", "", {}, None,
)  # fmt: skip
TOUCHES = [Recorded("touch", {"sigma_mm": value}, "touch", 1, measurement=True) for value in (0.1, 0.2)]
FILES = [Recorded("artefact", {"name": name, "sha256": sha256_of("made"), "size": 4}) for name in ("a.csv", "b.csv")]


def journal(folder: Path, *events: KnownEvent, ticks: Iterator[int]) -> ReadableJournal:
    with Journal.create(folder, lambda: next(ticks)) as written:
        for event in events:
            written.append(event)
    return ReadableJournal.of(folder)


def test_events_as_json_lines_are_read_back_with_their_time_step_and_fields(tmp_path: Path) -> None:
    lines = event_lines(journal(tmp_path, STARTED, *TOUCHES, ticks=iter([5, 1_000, 2_500]))).splitlines()
    found = [json.loads(line) for line in lines]
    names = ("seq", "time_ns", "kind", "step", "attempt")
    values = [tuple(each[name] for name in names) for each in found]
    touches = [(2, 1_000, "recorded", "touch", 1), (3, 2_500, "recorded", "touch", 1)]
    assert values == [(1, 5, "run_started", "", 0), *touches]
    assert [each["data"]["data"] for each in found[1:]] == [{"sigma_mm": 0.1}, {"sigma_mm": 0.2}]
    request = {"place": str(tmp_path), "form": "jsonl", "target": str(tmp_path / "out.jsonl")}
    assert export(request, print) == {"samples": 2, "events": 3, "missing": []}
    assert (tmp_path / "out.jsonl").read_text().splitlines() == lines


def test_documents_have_unix_times_also_after_the_run_was_resumed_by_another_clock(tmp_path: Path) -> None:
    resumed = RunResumed("kai", "2026-11-21T21:30:02Z", "", {})
    ticks = iter([10**9, 3 * 10**9, 7 * 10**9, 7 * 10**9 + 5 * 10**8])
    found = journal(tmp_path, STARTED, TOUCHES[0], resumed, TOUCHES[1], ticks=ticks)
    made = list(documents("small", found.entries, fold(found.entries), alive=False))
    began = 1795293002.0  # 2026-11-21 20:30:02 UTC
    times = [(name, each["time"] - began) for name, each in made if name != "descriptor"]
    assert times == [("start", 0.0), ("event", 2.0), ("event", 3600.5), ("stop", 3600.5)]
    assert (made[-1][1]["exit_status"], made[-1][1]["num_events"]) == ("fail", {"touch": 2}), "it has no end"
    assert "stop" not in dict(documents("small", found.entries, fold(found.entries), alive=True))
    with pytest.raises(InputError, match="the event that began the run cannot be read"):
        list(documents("small", found.entries[1:], fold(found.entries[1:]), alive=False))


def test_an_archive_holds_what_is_there_and_names_what_was_changed_lost_or_cannot_be_made(tmp_path: Path) -> None:
    found = journal(tmp_path, STARTED, *FILES, ticks=iter([1, 2, 3]))
    (tmp_path / "a.csv").write_text("edited")
    archive = Archive()
    add_run_files(archive, tmp_path, fold(found.entries))
    archive.add_tried("x.csv", "x", (tmp_path / "none").read_bytes)
    with zipfile.ZipFile(io.BytesIO(archive.to_bytes(lambda files: "\n".join(sorted(files))))) as held:
        names = ["a.csv", "journal.sqlite", "sources/cell.yaml", "sources/procedure.yaml"]
        assert held.read("README.txt").decode().splitlines() == names
        assert (held.read("a.csv"), held.read("sources/cell.yaml")) == (b"edited", b"name: a cell\n")
    changed = "a.csv: it is here as it is now; it was changed after the run made it"
    assert archive.missing[:2] == [changed, "b.csv: it is no longer in the run folder"]
    assert archive.missing[2].startswith("x.csv: [Errno 2] No such file or directory")
