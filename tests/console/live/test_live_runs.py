"""All runs of a folder, followed once for all pages: what appears, begins, ends and goes; who is called when."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from cellctl.console.live import LiveRuns
from cellctl.files import InputError
from cellctl.journal import RunResumed, StateChanged
from cellctl.operations import run_list
from cellctl.operations.run_indexing import summary_of
from cellctl.operations.run_list import RunSummary
from tests.helpers.engine import WrittenRun, registry

PATIENCE_S = 60.0


async def until(true: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not true():
            await asyncio.sleep(0.005)


def followed(folder: Path, see: Callable[[LiveRuns], Awaitable[Any]]) -> Any:
    """Follow the runs in `folder` while `see` runs."""

    async def go() -> Any:
        runs = LiveRuns(folder, registry, look_s=0.01, folder_s=0.02)
        async with runs.following():
            await until(lambda: not runs.reading)
            return await see(runs)

    return asyncio.run(go())


def rows(runs: LiveRuns) -> list[tuple[str, str, bool]]:
    return [(row.run, row.state, row.run in runs.active) for row in listed(runs)]


def listed(runs: LiveRuns) -> list[RunSummary]:
    return [summary_of(found) for found in runs.index.page()]


def test_a_run_appears_ends_is_resumed_and_is_deleted_while_the_folder_is_followed(tmp_path: Path) -> None:
    async def see(runs: LiveRuns) -> None:
        assert rows(runs) == []
        run = WrittenRun(tmp_path / "a")
        await until(lambda: rows(runs) == [("a", "running", True)])
        assert runs.active == ("a",)
        run.end()
        await until(lambda: rows(runs) == [("a", "finished", False)])
        assert runs.active == ()
        run.reopen()
        run.add(RunResumed("maria", "2026-11-22T11:00:00Z", "", {}), StateChanged("connecting", "running"))
        await until(lambda: rows(runs) == [("a", "running", True)])
        run.end("aborted")
        await until(lambda: rows(runs) == [("a", "aborted", False)])
        shutil.rmtree(run.folder)
        await until(lambda: rows(runs) == [("a", "vanished", False)])

    followed(tmp_path, see)


def test_the_list_has_the_newest_run_first_and_a_damaged_one_with_its_problem(tmp_path: Path) -> None:
    for name, hour in (("a", 10), ("b", 12), ("c", 11)):
        WrittenRun(tmp_path / name, calendar=f"2026-11-22T{hour}:00:00Z").end()
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "journal.sqlite").write_bytes(b"garbage" * 1000)
    (tmp_path / "no run").mkdir()

    async def see(runs: LiveRuns) -> None:
        found = listed(runs)
        assert [row.run for row in found if row.run != "d"] == ["b", "c", "a"]
        assert [(row.run, row.sentence) for row in found if row.state == "unreadable"] == [("d", "it is no journal")]

    followed(tmp_path, see)


@pytest.mark.long
def test_old_runs_are_read_once_and_again_only_when_they_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = WrittenRun(tmp_path / "run-0")
    run.measured(0)
    run.end()
    for number in range(1, 100):
        shutil.copytree(run.folder, tmp_path / f"run-{number}")
    read: list[str] = []
    original = run_list.read_journal
    monkeypatch.setattr(run_list, "read_journal", lambda path: read.append(path.parent.name) or original(path))

    async def see(runs: LiveRuns) -> None:
        assert len(listed(runs)) == 100
        assert sorted(read) == sorted(each.run for each in listed(runs))
        read.clear()
        looks = asyncio.Event()
        monkeypatch.setattr(runs, "_changes", _counted(runs._changes, looks, 2))
        await looks.wait()
        assert read == []
        shutil.copy(run.folder / "journal.sqlite", tmp_path / "run-7" / "journal.sqlite")
        await until(lambda: read)
        assert read == ["run-7"]

    followed(tmp_path, see)


def _counted(look: Callable[..., Any], event: asyncio.Event, number: int) -> Callable[..., Any]:
    done: list[Any] = []
    loop = asyncio.get_running_loop()

    def looked(*words: Any) -> Any:
        done.append(look(*words))
        if len(done) > number:
            loop.call_soon_threadsafe(event.set)
        return done[-1]

    return looked


def test_ten_pages_are_called_once_for_all_changes_of_a_look_and_one_that_fails_stops_no_other(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "a")
    calls = [0] * 12

    def page(number: int) -> Callable[[], None]:
        def changed() -> None:
            calls[number] += 1
            if number == 10:
                raise RuntimeError("this page is gone")

        return changed

    async def see(runs: LiveRuns) -> None:
        ends = [runs.subscribe(page(number), "a") for number in range(11)]
        runs.subscribe(page(11), "another run")
        live = runs.run("a")
        await until(lambda: live.known)
        before = list(calls)
        with run.unsafe():
            for number in range(400):
                run.say(f"line {number}")
        await until(lambda: live.snapshot.status.message == "line 399")
        after = [now - then for now, then in zip(calls, before, strict=True)]
        assert after[:10] == [after[0]] * 10
        assert 1 <= after[0] <= 3
        assert calls[10] == 1
        assert calls[11] == 0
        ends[0]()
        run.say("the end")
        await until(lambda: live.snapshot.status.message == "the end")
        assert calls[0] == before[0] + after[0]
        assert calls[1] > calls[0]

    followed(tmp_path, see)


def test_a_run_that_cannot_be_shown_does_not_stop_the_others(tmp_path: Path) -> None:
    strange, good = WrittenRun(tmp_path / "a"), WrittenRun(tmp_path / "b")

    async def see(runs: LiveRuns) -> None:
        await until(lambda: len(runs.active) == 2)
        strange.did("plan", {"values": 3})  # no list
        await until(lambda: runs.run("a").snapshot.problem)
        good.say("still here")
        await until(lambda: runs.run("b").snapshot.status.message == "still here")

    followed(tmp_path, see)


def test_a_run_that_nobody_writes_is_read_when_it_is_asked_for_and_a_missing_one_is_a_problem(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "a")
    run.measured(0)
    run.end()

    async def see(runs: LiveRuns) -> None:
        found = await runs.snapshot("a")
        assert (found.status.state, found.status.done, len(found.state.rows)) == ("finished", 2, 1)
        missing = await runs.snapshot("none")
        assert missing.problem is not None
        assert missing.problem.what == "there is no journal"
        assert [each.run for each in listed(runs)] == ["a"]
        for name in ("", "..", "a/b", "../a", "a\\b", 300 * "a"):
            with pytest.raises(InputError, match="is no name of a run"):
                runs.run(name)

    followed(tmp_path, see)


def test_a_run_whose_summary_fails_is_listed_with_its_problem_and_the_others_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in "ab":
        WrittenRun(tmp_path / name).end()
    original = run_list.run_summary

    def failing(folder: Path, state: Any) -> Any:
        return original(folder, state) if folder.name == "a" else 1 / 0

    monkeypatch.setattr(run_list, "run_summary", failing)

    async def see(runs: LiveRuns) -> None:
        assert {row.run: row.state for row in listed(runs)} == {"a": "finished", "b": "unreadable"}
        assert "ZeroDivisionError" in next(row.sentence or "" for row in listed(runs) if row.run == "b")

    followed(tmp_path, see)


def test_a_run_that_a_page_shows_stays_followed_while_many_others_are_asked_for(tmp_path: Path) -> None:
    for number in range(12):
        WrittenRun(tmp_path / f"run-{number}").end()

    async def see(runs: LiveRuns) -> None:
        shown = runs.run("run-0")
        runs.subscribe(lambda: None, "run-0")
        for number in range(12):
            await runs.snapshot(f"run-{number}")
        await until(lambda: len(runs._followed) == 9)
        assert runs.run("run-0") is shown
        assert "run-1" not in runs._followed

    followed(tmp_path, see)
