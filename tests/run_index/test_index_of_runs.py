"""The index says what the journals say: whatever is moved, copied, damaged, cut or written at once."""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import random
import shutil
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine, text

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.files import InputError
from cellctl.operations import run_list
from cellctl.operations.fleet import fleet
from cellctl.operations.launch import tell_index
from cellctl.operations.run_indexing import (
    current_index,
    rebuild_index,
    run_rows,
    tell_existing_index,
    update,
    verify_index,
)
from cellctl.run_index import FILE_NAME, VARIABLE, RunFilter, opened_index
from tests.helpers.arms import kr5_model
from tests.helpers.engine import WrittenRun
from tests.helpers.journals import run_in
from tests.helpers.many_runs import made_calibration, made_check, made_runs, not_durable
from tests.run_index.conftest import Server

CUTS = 30


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    made_runs(folder, robots=2, days=3)
    return folder


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the runs whose journals are read from now on."""
    names: list[str] = []
    original = run_list.read_journal
    monkeypatch.setattr(run_list, "read_journal", lambda path: names.append(path.parent.name) or original(path))
    return names


def states(runs: Path) -> dict[str, tuple[str, str | None]]:
    return {row.run: (row.state, row.note) for row in run_rows(runs)}


def test_only_what_is_new_or_changed_is_read(runs: Path, read: list[str]) -> None:
    run_rows(runs)
    assert len(read) == 6
    read.clear()
    run_rows(runs)
    assert read == []
    made_check(runs, 2, 0)
    assert len(run_rows(runs)) == 7
    assert len(read) == 1


def test_the_latest_run_of_each_cell_and_the_latest_that_passed(tmp_path: Path) -> None:
    for name, day, verdict, cell in (
        ("a", "2026-01-01", "better", "hall7"),
        ("b", "2026-01-02", "better", "hall8"),
        ("c", "2026-01-03", "better", "hall7"),
        ("d", "2026-01-04", "not better", "hall7"),
    ):
        run_in(tmp_path, name, day, "925185", verdict, cell=cell)
    with current_index(tmp_path) as index:
        assert [found.run for found in index.latest_of_cells()] == ["d", "b"]
        assert [found.run for found in index.latest_of_cells({"better", "agree"})] == ["c", "b"]


def test_a_run_that_ended_is_told_to_the_index_and_one_in_progress_is_read_until_it_ends(
    runs: Path, read: list[str]
) -> None:
    run = WrittenRun(runs / "own")
    assert states(runs)["own"][0] == "running"
    run.end("aborted")
    tell_index(run.folder)
    read.clear()
    assert states(runs)["own"][0] == "aborted"
    assert read == []
    run.reopen()
    assert states(runs)["own"][0] == "aborted"  # a resume tells it before the journal changes: `carry_out`
    tell_index(run.folder, resumed=True)
    run.say("on again")
    run.journal.close()
    read.clear()
    states(runs)
    assert read == ["own"]


def test_a_folder_that_was_renamed_copied_or_removed_is_listed_as_that(runs: Path) -> None:
    first, second, third = sorted(row.run for row in run_rows(runs))[:3]
    (runs / first).rename(runs / "another name")
    shutil.copytree(runs / second, runs / "copied")
    shutil.rmtree(runs / third)
    found = states(runs)
    assert first not in found
    assert found["another name"] == ("finished", f"renamed, began as {first}")
    assert found["copied"] == ("finished", f"copy of {second}")
    assert found[second] == ("finished", None)
    assert found[third] == ("vanished", "vanished")
    assert [row.run for row in run_rows(runs, RunFilter(state="vanished"))] == [third]
    rebuild_index(runs)
    assert third not in states(runs)


def test_a_report_written_again_is_told_to_the_index_that_there_is_and_makes_none(runs: Path, read: list[str]) -> None:
    folder = next(runs.glob("daily*"))
    tell_existing_index(folder)
    assert not (runs / FILE_NAME).exists()
    run_rows(runs)
    read.clear()
    tell_existing_index(folder)
    assert read == [folder.name]


def test_a_damaged_run_is_listed_as_unreadable_and_a_repaired_one_as_it_is(runs: Path, tmp_path: Path) -> None:
    name = run_rows(runs)[0].run
    journal = runs / name / "journal.sqlite"
    whole = journal.read_bytes()
    journal.write_bytes(whole[:4096] + b"\xff" * 4096 + whole[8192:])
    assert verify_index(runs).different == (name,)
    rebuild_index(runs)
    assert states(runs)[name][0] == "unreadable"
    journal.write_bytes(whole)
    assert states(runs)[name][0] == "finished"
    journal.unlink()
    with opened_index(runs) as index:
        update(index, runs, thorough=True)
        assert name not in [found.run for found in index.page(RunFilter(state="finished"))]


def test_an_index_moves_with_its_folder(runs: Path, read: list[str], tmp_path: Path) -> None:
    before = run_rows(runs)
    read.clear()
    runs.rename(tmp_path / "elsewhere")
    assert run_rows(tmp_path / "elsewhere") == before
    assert read == []


@pytest.mark.parametrize(
    "content", [b"", b"no database at all" * 500, b"SQLite format 3\0" + bytes(5000)], ids=["empty", "text", "zeros"]
)
def test_a_file_that_is_no_index_is_made_anew(runs: Path, content: bytes) -> None:
    before = run_rows(runs)
    for beside in ("-wal", "-shm"):
        (runs / f"{FILE_NAME}{beside}").unlink(missing_ok=True)
    (runs / FILE_NAME).write_bytes(content)
    assert run_rows(runs) == before
    assert verify_index(runs).agrees


def test_an_index_damaged_inside_is_made_anew(runs: Path) -> None:
    before = run_rows(runs)
    file = runs / FILE_NAME
    content = bytearray(file.read_bytes())
    for page in range(2, len(content) // 4096):
        content[page * 4096 : page * 4096 + 200] = b"\xff" * 200
    file.write_bytes(content)
    assert run_rows(runs) == before
    run_rows(runs)
    assert verify_index(runs).agrees


def test_a_database_of_another_program_is_left_alone_and_runs_are_listed(runs: Path) -> None:
    with create_engine(f"sqlite:///{runs / FILE_NAME}").begin() as connection:
        connection.execute(text("PRAGMA application_id = 1234"))
        connection.execute(text("CREATE TABLE runs (mine TEXT)"))
    content = (runs / FILE_NAME).read_bytes()
    assert len(run_rows(runs)) == 6
    assert (runs / FILE_NAME).read_bytes() == content


def test_a_run_does_not_fail_for_an_index_that_cannot_be_written(runs: Path, caplog: Any) -> None:
    (runs / FILE_NAME).mkdir()
    with caplog.at_level(logging.WARNING):
        tell_index(next(iter(runs.glob("daily*"))))
        assert len(run_rows(runs)) == 6
    assert "is not in the index of the runs yet" in caplog.text


def test_an_index_of_a_newer_version_is_not_used(runs: Path) -> None:
    run_rows(runs)
    with create_engine(f"sqlite:///{runs / FILE_NAME}").begin() as connection:
        connection.execute(text("UPDATE index_version SET version = 1000"))
    assert len(run_rows(runs)) == 6
    with create_engine(f"sqlite:///{runs / FILE_NAME}").begin() as connection:
        assert connection.execute(text("SELECT version FROM index_version")).scalar() == 1000


def test_many_writers_at_once_lose_and_double_nothing(runs: Path) -> None:
    with not_durable():
        folders = [made_check(runs, 10 + number, 0) for number in range(24)]

    def write(own: list[Path]) -> None:
        for folder in own:
            tell_index(folder)
            run_rows(runs)

    writers = [threading.Thread(target=write, args=(folders[number::4],)) for number in range(4)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert len(run_rows(runs)) == 30
    assert verify_index(runs).agrees


def test_pages_and_orders_are_those_of_the_whole_list(runs: Path) -> None:
    with current_index(runs) as index:
        whole = [found.run for found in index.page()]
        assert [found.run for start in range(0, 6, 4) for found in index.page(offset=start, limit=4)] == whole
        by_serial = [json.loads(found.content)["devices"]["robot"]["serial"] for found in index.page(order="serial")]
        assert by_serial == sorted(by_serial, reverse=True)
        assert index.values("serial") == ["R00000", "R00001"]
        assert index.count(RunFilter(text="r00001 kim")) == 3


def test_the_commands_verify_and_rebuild(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def cellctl(*words: str) -> int:
        return exit_codes.exit_code_of(lambda: app([*words, "--runs", str(runs)], standalone_mode=False))

    assert cellctl("index", "verify") == 1
    assert "not indexed: daily_check-" in capsys.readouterr().out
    assert cellctl("index", "rebuild") == 0
    assert cellctl("index", "verify") == 0
    assert "6 runs, as in the journals" in capsys.readouterr().out


@pytest.mark.parametrize("url", ["no url", "mysql://host/name"])
def test_a_url_of_no_index_is_bad_input(runs: Path, monkeypatch: pytest.MonkeyPatch, url: str) -> None:
    monkeypatch.setenv(VARIABLE, url)
    with pytest.raises(InputError, match="--index"):
        run_rows(runs)


def test_a_server_that_does_not_answer_is_replaced_by_the_folders_own(
    runs: Path, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    monkeypatch.setenv(VARIABLE, "postgresql://cellctl@127.0.0.1:1/postgres")
    assert len(run_rows(runs)) == 6
    assert (runs / FILE_NAME).is_file()
    assert "cannot be used" in caplog.text


def _works(runs: Path, first: int) -> None:
    """Write runs and tell the index, rename and remove some, until it is killed."""
    with not_durable():
        for number in range(first, first + 1000):
            folder = made_check(runs, number, 1)
            tell_index(folder)
            if number % 3 == 0:
                folder.rename(runs / f"renamed-{number}")
            elif number % 5 == 0:
                folder.rename(runs.parent / f"gone-{number}")
            run_rows(runs)


def _cut(runs: Path, first: int, seconds: float) -> None:
    worker = multiprocessing.get_context("fork").Process(target=_works, args=(runs, first))
    worker.start()
    time.sleep(seconds)  # noqa: TID251 - a random moment of another process, in wall time
    os.kill(worker.pid or 0, signal.SIGKILL)
    worker.join()


def _agrees(runs: Path) -> None:
    """Each folder with a run is listed once, and as its journal says."""
    listed = [row for row in run_rows(runs) if row.state not in ("vanished", "not begun")]
    assert sorted(row.run for row in listed) == sorted(each.parent.name for each in runs.glob("*/journal.sqlite"))
    found = verify_index(runs)
    assert found.agrees, found


@pytest.mark.long
def test_a_process_killed_at_random_moments_loses_and_doubles_nothing(runs: Path) -> None:
    moments = random.Random(32)
    for cut in range(CUTS):
        _cut(runs, 100 + 100 * cut, moments.uniform(0.0, 0.15))
        _agrees(runs)
    assert len(run_rows(runs)) > 6


@pytest.mark.long
def test_a_server_serves_several_folders_and_knows_a_run_that_moved_between_them(
    runs: Path, tmp_path: Path, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = states(runs)
    monkeypatch.setenv(VARIABLE, server.url)
    other = tmp_path / "other"
    made_runs(other, robots=1, days=2, first_robot=7)
    assert states(runs) == before
    assert len(run_rows(other)) == 2
    moved = sorted(before)[0]
    shutil.move(runs / moved, other / moved)
    assert states(other)[moved] == ("finished", None)
    state, note = states(runs)[moved]
    assert state == "vanished"
    assert note is not None
    assert note.startswith("moved to")
    assert str(other) in note
    with opened_index(runs) as index:
        assert len(index.lines(RunFilter(), "run", everywhere=True)) == 9
    kr5_model().save(tmp_path / "model.json")
    made_calibration(other, 7, 30, tmp_path / "model.json")
    rebuild_index(other)
    with opened_index(runs) as index:  # a fleet is that of all folders
        robots = {each.serial: each.charts for each in fleet(index, runs).robots}
        assert len(robots) == 3
        assert robots.pop("R00007") > 20
        assert set(robots.values()) == {0}
    assert verify_index(runs).agrees
    assert rebuild_index(other).runs == 4


def test_the_list_of_all_hosts_says_of_each_run_where_it_is(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(VARIABLE, f"sqlite:///{tmp_path / 'shared.sqlite'}")
    other = tmp_path / "other"
    made_runs(other, robots=1, days=1, first_robot=7)
    own, foreign = len(run_rows(runs)), len(run_rows(other))
    for words, count in (((), own), (("--all-hosts",), own + foreign)):
        app(["runs", "--runs", str(runs), "--json", "-", *words], standalone_mode=False)
        listed = json.loads(capsys.readouterr().out)["runs"]
        assert len(listed) == count
    assert {run["place"].partition(":")[2] for run in listed} == {str(runs.resolve()), str(other.resolve())}


@pytest.mark.long
def test_server_and_process_killed_at_random_moments_lose_and_double_nothing(
    runs: Path, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, server.url)
    moments = random.Random(33)
    for cut in range(CUTS):
        if cut % 2:
            _cut(runs, 100 + 100 * cut, moments.uniform(0.0, 0.15))
        else:
            worker = multiprocessing.get_context("fork").Process(target=_works, args=(runs, 100 + 100 * cut))
            worker.start()
            time.sleep(moments.uniform(0.0, 0.15))  # noqa: TID251 - another process, in wall time
            server.kill()
            worker.kill()
            worker.join()
            server.start()
        _agrees(runs)
    with opened_index(runs, strict=True) as index:
        assert index.count() > 6
