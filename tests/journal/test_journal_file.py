"""What was appended is there: after a crash, for a second reader, on a full disk; and nobody else can write it."""

import fcntl
import itertools
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from cellctl.journal import (
    DevicesConnected,
    Journal,
    JournalError,
    OperatorAction,
    Outcome,
    RawEvent,
    Recorded,
    RunEnded,
    RunResumed,
    RunStarted,
    Said,
    SourceFile,
    StateChanged,
    StepEnded,
    StepFailure,
    StepStarted,
    check_journal,
    is_being_written,
    read_journal,
)
from tests.helpers.runs import child, edited

EVERY_KIND = [
    RunStarted(
        procedure=SourceFile("p.yaml", "procedure: p\n", "ab"),
        cell=SourceFile("c.yaml", "name: ü\n", "cd"),
        parameters={"speed": 5.0, "fit": 50},
        seed=1,
        clock="lockstep",
        operator="mw",
        calendar="2026-11-21T19:24:33Z",
        code_sha256="ef",
        versions={"cellctl": "0.1.0"},
    ),
    DevicesConnected({"robot": {"serial": "SIM-1", "simulated": True}}),
    StateChanged("connecting", "running"),
    StepStarted("points[0].touch", 1, True, "sphere.touch"),
    Recorded("touch", {"joints": [0.1, -90.0], "sphere": "S1"}, "points[0].touch", 1),
    StepEnded("points[0].touch", 1, Outcome.FAILED, None, StepFailure("NoContact", "nothing there", "look")),
    StepEnded("points[0].touch", 2, Outcome.DONE, {"joints": [0.1]}),
    Said("12 of 80", "points[0].touch"),
    OperatorAction("pause", "mw"),
    RunResumed("mw", "2026-11-21T20:24:33Z", "ef", {"cellctl": "0.1.0"}, acknowledged=True),
    RunEnded("finished", "better", "", {"after": {"mean": 0.02}}),
]


@pytest.fixture
def now_ns():
    return itertools.count(1000).__next__


@pytest.fixture
def journal(tmp_path, now_ns):
    with Journal.create(tmp_path / "run", now_ns) as made:
        yield made


def events(run):
    return [entry.event for entry in read_journal(run)]


def test_every_event_reads_back_as_it_was_appended(journal):
    entries = [journal.append(event) for event in EVERY_KIND]
    assert list(read_journal(journal.path)) == entries
    assert [entry.event for entry in entries] == EVERY_KIND
    assert [(entry.seq, entry.time_ns) for entry in entries] == [(i + 1, 1000 + i) for i in range(len(EVERY_KIND))]


def test_a_reader_sees_each_event_while_the_writer_lives_and_asks_for_what_is_new(journal):
    journal.append(Said("one"))
    assert events(journal.path.parent) == [Said("one")]
    journal.append(Said("two"))
    assert [entry.event for entry in read_journal(journal.path, after=1)] == [Said("two")]


def test_a_finished_run_is_one_file_that_needs_nothing_beside_it(journal, tmp_path):
    journal.append(Said("one"))
    journal.close()
    alone = tmp_path / "copy.sqlite"
    alone.write_bytes(journal.path.read_bytes())
    assert events(alone) == [Said("one")]
    assert not journal.path.with_name("journal.sqlite-wal").exists()


def test_a_reader_that_holds_on_does_not_keep_the_writer_from_closing(journal):
    journal.append(Said("one"))
    journal.append(Said("two"))
    reading = read_journal(journal.path)
    next(reading)
    journal.close()
    assert [entry.event for entry in reading] == [Said("two")]
    assert events(journal.path) == [Said("one"), Said("two")]


def test_the_file_of_a_finished_run_has_all_events_also_if_a_reader_had_it_open(journal, tmp_path):
    journal.append(Said("one"))
    with sqlite3.connect(f"{journal.path.as_uri()}?mode=ro", uri=True) as reader:
        assert reader.execute("SELECT count(*) FROM events").fetchone() == (1,)
        journal.append(Said("two"))
        journal.close()
        alone = tmp_path / "copy.sqlite"
        alone.write_bytes(journal.path.read_bytes())
    reader.close()
    assert events(alone) == [Said("one"), Said("two")]


def test_a_reopened_journal_continues_counting(journal, now_ns):
    journal.append(Said("one"))
    journal.close()
    with Journal.reopen(journal.path.parent, now_ns) as again:
        assert again.append(Said("two")).seq == 2
    assert events(journal.path) == [Said("one"), Said("two")]


def test_one_run_has_one_writer_and_the_second_gets_the_name_of_the_process(journal, now_ns):
    for open_second in (Journal.reopen, Journal.create):
        with pytest.raises(JournalError, match=f"process {os.getpid()} writes this run"):
            open_second(journal.path.parent, now_ns)
    assert is_being_written(journal.path)
    journal.append(Said("the first goes on"))
    journal.close()
    assert not is_being_written(journal.path)


def test_a_process_that_asks_who_writes_does_not_keep_a_run_from_beginning(tmp_path, now_ns):
    (tmp_path / "run").mkdir()
    with (tmp_path / "run" / "journal.lock").open("a+") as asking:
        fcntl.flock(asking, fcntl.LOCK_SH)  # as `writer_of` for a moment
        threading.Timer(0.05, lambda: fcntl.flock(asking, fcntl.LOCK_UN)).start()
        with Journal.create(tmp_path / "run", now_ns) as journal:
            assert journal.append(Said("one")).seq == 1


def test_a_journal_is_not_seen_before_it_is_one(tmp_path, now_ns, monkeypatch):
    """Half a journal would be taken for something else: by who watches a run begin, and after a crash just then."""
    path, made = tmp_path / "run" / "journal.sqlite", []

    class Watched(sqlite3.Connection):
        def executescript(self, script):
            made.append(script)
            assert not path.exists()
            return super().executescript(script)

    with monkeypatch.context() as watching:
        watching.setattr(sqlite3, "connect", partial(sqlite3.connect, factory=Watched))
        journal = Journal.create(path.parent, now_ns)
    assert any("CREATE TABLE" in script for script in made)
    journal.append(Said("one"))
    assert events(path) == [Said("one")]
    journal.close()
    assert {each.name for each in path.parent.iterdir()} == {"journal.sqlite", "journal.lock"}


def test_a_new_run_does_not_overwrite_an_old_one(journal, now_ns):
    journal.append(Said("one"))
    journal.close()
    with pytest.raises(JournalError, match="there is a journal already"):
        Journal.create(journal.path.parent, now_ns)
    assert events(journal.path) == [Said("one")]


@pytest.mark.parametrize("value", [float("nan"), float("-inf"), object(), "\ud800", {1, 2}])
def test_what_json_cannot_hold_is_refused_by_name_and_nothing_is_written(journal, value):
    with pytest.raises(ValueError, match=r"event 'recorded' of step 'a' cannot be recorded"):
        journal.append(Recorded("touch", {"x": [1, value]}, "a", 1))
    assert events(journal.path) == []


def test_a_full_disk_is_reported_and_what_was_committed_is_kept(journal, now_ns):
    connection = journal._connection  # a full disk as SQLite sees it: no page more than there are
    pages = connection.execute("PRAGMA page_count").fetchone()[0]
    connection.execute(f"PRAGMA max_page_count = {pages + 2}")
    written = []
    with pytest.raises(JournalError, match="the disk is full\n    free some space"):
        written.extend(journal.append(Said(f"{number} " + "x" * 500)) for number in range(1000))
    assert written
    assert list(read_journal(journal.path)) == written
    connection.execute("PRAGMA max_page_count = 100000")
    journal.append(Said("there is space again"))
    assert len(events(journal.path)) == len(written) + 1


def test_a_run_folder_that_cannot_be_made_is_reported(tmp_path, now_ns):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "run"):
        with pytest.raises(JournalError, match=r"cannot be used: .*\n    check the path"):
            Journal.create(folder, now_ns)


@contextmanager
def somebody_without_rights():
    """Root may write anywhere; in here the process is nobody in particular."""
    if os.geteuid():
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


@pytest.fixture
def folder():
    with tempfile.TemporaryDirectory() as made:
        Path(made).chmod(0o755)
        yield Path(made)
        Path(made).chmod(0o755)


def test_a_read_only_folder_is_reported_when_a_run_is_to_begin_there(folder, now_ns):
    folder.chmod(0o555)
    with somebody_without_rights(), pytest.raises(JournalError, match="Permission denied"):
        Journal.create(folder / "run", now_ns)
    with somebody_without_rights(), pytest.raises(JournalError, match="Permission denied"):
        Journal.create(folder, now_ns)


def test_a_finished_run_in_a_read_only_folder_can_be_read_and_not_be_resumed(folder, now_ns):
    with Journal.create(folder, now_ns) as journal:
        journal.append(Said("one"))
    folder.chmod(0o555)
    with somebody_without_rights():
        assert events(folder) == [Said("one")]
        with pytest.raises(JournalError, match=r"cannot be used|cannot be written"):
            Journal.reopen(folder, now_ns)


def test_a_crashed_run_in_a_read_only_folder_is_never_read_short(folder, journal):
    """Its last events are in the log beside the file; where SQLite cannot use that, it has to be said."""
    journal.append(Said("one"))
    for name in ("journal.sqlite", "journal.sqlite-wal"):
        (folder / name).write_bytes(journal.path.with_name(name).read_bytes())
    folder.chmod(0o555)
    with somebody_without_rights(), pytest.raises(JournalError, match="has to be copied first"):
        events(folder)
    folder.chmod(0o755)
    assert events(folder) == [Said("one")]


def test_no_journal_is_reported(tmp_path, now_ns):
    for use in (events, lambda folder: Journal.reopen(folder, now_ns)):
        with pytest.raises(JournalError, match="there is no journal"):
            use(tmp_path)


def test_a_file_of_something_else_is_no_journal(tmp_path, now_ns):
    path = tmp_path / "journal.sqlite"
    path.write_text("# A file of text.\n" * 100)
    for use in (events, lambda folder: Journal.reopen(folder, now_ns)):
        with pytest.raises(JournalError, match="it is no journal"):
            use(tmp_path)
    path.unlink()
    sqlite3.connect(path).execute("CREATE TABLE other (x)").connection.close()
    with pytest.raises(JournalError, match="it is no journal"):
        events(tmp_path)


def test_a_damaged_file_is_reported_and_not_a_traceback(journal):
    for number in range(200):
        journal.append(Said(f"{number} " + "x" * 300))
    journal.close()
    data = bytearray(journal.path.read_bytes())
    half = len(data) // 2
    data[half : half + 8192] = bytes(8192)
    journal.path.write_bytes(data)
    with pytest.raises(JournalError, match=r"it is damaged|is damaged:"):
        events(journal.path)


def by_hand(journal, statement, *values):
    """What another version of the program might have left in the file."""
    journal.close()
    with sqlite3.connect(journal.path) as connection:
        connection.execute(statement, values)
    connection.close()


INSERT = "INSERT INTO events (time_ns, kind, step, attempt, data) VALUES (1, ?, '', 0, ?)"


def test_kinds_of_a_newer_version_are_kept_raw_and_new_fields_are_passed_over(journal):
    by_hand(journal, INSERT, "temperature_seen", '{"celsius": 21.5}')
    by_hand(journal, INSERT, "said", '{"text": "warm", "colour": "red"}')
    assert events(journal.path) == [RawEvent("temperature_seen", {"celsius": 21.5}), Said("warm")]


def test_a_row_of_no_step_has_attempt_0_in_the_file(journal):
    by_hand(journal, INSERT, "recorded", '{"row_kind": "touch", "data": {"x": 1}}')
    assert events(journal.path) == [Recorded("touch", {"x": 1})]


def test_an_event_without_what_its_kind_has_is_damaged(journal):
    by_hand(journal, INSERT, "said", "{}")
    with pytest.raises(JournalError, match="event 1 is damaged"):
        events(journal.path)


def test_a_journal_of_a_newer_format_is_refused(journal, now_ns):
    by_hand(journal, "PRAGMA user_version = 99")
    for use in (events, lambda path: Journal.reopen(path.parent, now_ns)):
        with pytest.raises(JournalError, match="written by a newer cellctl"):
            use(journal.path)


def test_events_can_be_neither_changed_nor_removed(journal):
    journal.append(Said("one"))
    for statement in ("UPDATE events SET data = '{}'", "DELETE FROM events"):
        with pytest.raises(sqlite3.IntegrityError, match="only grows"):
            by_hand(journal, statement)
    assert events(journal.path) == [Said("one")]


def begun(journal, texts="abcde"):
    for text in texts:
        journal.append(Said(text))
    journal.close()


def test_an_untouched_journal_is_as_it_was_written_and_its_last_digest_stands_for_all_of_it(journal, now_ns, tmp_path):
    begun(journal)
    check = check_journal(journal.path)
    assert (check.events, check.without, check.changed) == (5, 0, ())
    with Journal.create(tmp_path / "other", now_ns) as other:
        begun(other, "abcdf")
    assert len(check.digest) == 64
    assert check_journal(other.path).digest != check.digest


@pytest.mark.parametrize(
    ("column", "found"),
    [
        ('data = \'{"text": "C"}\'', "event 3 is not as it was written"),
        ("time_ns = time_ns + 1", "event 3 is not as it was written"),
        ("step = 's'", "event 3 is not as it was written"),
        ("digest = 'x'", "events 3 to 4 are not as they were written"),
    ],
)
def test_one_changed_digit_is_found_at_its_event(journal, column, found):
    begun(journal)
    edited(journal.path, f"UPDATE events SET {column} WHERE seq = 3")
    assert check_journal(journal.path).changed == (found,)


def test_removed_events_are_named(journal):
    begun(journal)
    edited(journal.path, "DELETE FROM events WHERE seq IN (2, 3)")
    assert check_journal(journal.path).changed == ("events 2 to 3 are missing", "event 4 is not as it was written")


def test_a_resumed_journal_continues_the_chain_and_a_change_before_is_still_found(journal, now_ns):
    begun(journal)
    edited(journal.path, "UPDATE events SET time_ns = 5 WHERE seq = 2")
    with Journal.reopen(journal.path.parent, now_ns) as again:
        again.append(Said("more"))
    check = check_journal(journal.path)
    assert (check.events, check.changed) == (6, ("event 2 is not as it was written",))


def test_a_journal_of_before_digests_is_read_resumed_and_protected_from_then_on(journal, now_ns):
    begun(journal)
    edited(journal.path, "ALTER TABLE events DROP COLUMN digest")
    check = check_journal(journal.path)
    assert (check.events, check.without, check.digest, check.changed) == (5, 5, "", ())
    with Journal.reopen(journal.path.parent, now_ns) as again:
        again.append(Said("more"))
    assert (check_journal(journal.path).without, check_journal(journal.path).changed) == (0, ())
    edited(journal.path, "UPDATE events SET time_ns = 5 WHERE seq = 2")
    assert check_journal(journal.path).changed == ("events 1 to 6 are not as they were written",)


APPENDING = """
import sys, itertools
from pathlib import Path
from cellctl.journal import Journal, Recorded
journal = Journal.create(Path(sys.argv[1]), lambda: 0)
for number in itertools.count(1):
    entry = journal.append(Recorded("touch", {"number": number, "more": "x" * 200}))
    print(entry.seq, flush=True)
"""


@pytest.mark.parametrize("seed", range(3))
def test_kill_minus_nine_loses_nothing_that_append_returned_from(tmp_path, now_ns, seed):
    folder = tmp_path / "run"
    enough = random.Random(seed).randrange(1, 300)
    with child([sys.executable, "-c", APPENDING, str(folder)], stdout=subprocess.PIPE, text=True) as process:
        told = [int(next(process.stdout)) for _ in range(enough)]
        assert is_being_written(folder)
        process.send_signal(signal.SIGKILL)
        told += [int(line) for line in process.stdout if line.endswith("\n")]
    assert not is_being_written(folder)
    found = list(read_journal(folder))
    assert [entry.seq for entry in found] == list(range(1, len(found) + 1))
    assert [entry.event.data["number"] for entry in found] == [entry.seq for entry in found]
    assert told[-1] <= len(found) <= told[-1] + 1
    with Journal.reopen(folder, now_ns) as journal:
        assert journal.append(Said("on")).seq == len(found) + 1


def test_the_file_is_plain_sqlite_with_json_that_other_programs_read(journal):
    journal.append(Recorded("touch", {"b": 1.5, "a": "ü"}, "points[3].touch", 2))
    journal.close()
    with sqlite3.connect(journal.path) as connection:
        row = connection.execute("SELECT kind, step, attempt, data FROM events").fetchone()
    connection.close()
    assert row[:3] == ("recorded", "points[3].touch", 2)
    assert json.loads(row[3]) == {
        "row_kind": "touch",
        "data": {"a": "ü", "b": 1.5},
        "version": 1,
        "measurement": None,
    }
