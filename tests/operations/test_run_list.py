"""The list of runs and the search in it: by words, state, verdict, robot, procedure and date."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.journal import RunStarted, RunState, SourceFile
from cellctl.operations.run_indexing import run_rows
from cellctl.operations.run_list import is_simulated
from cellctl.run_index import RunFilter
from tests.helpers.journals import run_in

UNBORN = "sphere_selfcal-20260101T000000Z"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    run_in(folder, "c", "2026-09-01", "925185")
    run_in(folder, "a", "2026-11-20", "925185", "no better")
    run_in(folder, "b", "2026-11-21", "111111", procedure="daily_check")
    (folder / "torn").mkdir()
    (folder / "torn" / "journal.sqlite").write_bytes(b"SQLite format 3\0 torn")
    (folder / "tables").mkdir()
    (folder / UNBORN).mkdir()
    (folder / UNBORN / "output.txt").write_text("cellctl: simulator: did not start")
    (folder / "sphere_selfcal-20260102T000000Z").mkdir()
    (folder / "sphere_selfcal-20260102T000000Z" / "letter.txt").touch()
    return folder


def names(runs: Path, **asked: str) -> list[str]:
    return [row.run for row in run_rows(runs, RunFilter(**asked)) if row.run != UNBORN]


def test_runs_are_listed_newest_first_by_when_they_began_and_not_by_when_the_files_were_copied(runs: Path) -> None:
    assert [name for name in names(runs) if name != "torn"] == ["b", "a", "c"]


def test_an_unreadable_run_is_listed_with_what_is_wrong(runs: Path) -> None:
    (row,) = run_rows(runs, RunFilter(state="unreadable"))
    assert row.run == "torn"
    assert row.sentence


def test_a_run_that_ended_before_its_journal_existed_is_listed_with_its_output(runs: Path) -> None:
    (row,) = run_rows(runs, RunFilter(procedure="sphere_selfcal"))
    assert (row.run, row.state, row.problem) == (UNBORN, "not begun", "simulator: did not start")


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ({"text": "kim 925185"}, ["a", "c"]),
        ({"text": "HALL7 daily"}, ["b"]),
        ({"text": "no such word"}, []),
        ({"verdict": "better"}, ["b", "c"]),
        ({"verdict": "No better"}, ["a"]),
        ({"serial": "925185", "state": "finished"}, ["a", "c"]),
        ({"serial": "9251"}, []),
        ({"procedure": "daily_check"}, ["b"]),
        ({"since": "2026-11-20", "until": "2026-11-20"}, ["a"]),
        ({"until": "2026-11"}, ["b", "a", "c"]),
        ({"since": "2026-11-20T09:00:00Z", "state": "finished"}, ["b"]),
    ],
)
def test_a_search_finds_the_runs_that_fit_all_of_it(runs: Path, asked: dict[str, str], found: list[str]) -> None:
    assert [name for name in names(runs, **asked) if name != "torn"] == found


def test_the_command_line_searches_alike(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def cellctl(*words: str) -> int:
        return exit_codes.exit_code_of(lambda: app(["runs", "--runs", str(runs), *words], standalone_mode=False))

    assert cellctl("--search", "kim", "--verdict", "better", "--json", str(tmp_path / "found.json")) == 0
    assert [row["run"] for row in json.loads((tmp_path / "found.json").read_text())["runs"]] == ["b", "c"]
    assert "111111" not in capsys.readouterr().out
    assert cellctl("--search", "nothing of this") == 0
    assert "No run" in capsys.readouterr().out


def test_a_run_says_whether_its_cell_was_simulated(tmp_path: Path) -> None:
    source = SourceFile("cell.yaml", "name: x\nsimulate: {seed: 1}\n", "0")
    run = RunState(started=RunStarted(source, source, {}, 1, "lockstep", "me", "2026-01-02T03:04:05Z", "", {}))
    assert is_simulated(run)
    real = SourceFile("cell.yaml", "name: x\n# simulate: later\n", "0")
    run = RunState(started=RunStarted(source, real, {}, 1, "lockstep", "me", "2026-01-02T03:04:05Z", "", {}))
    assert not is_simulated(run)
    run.identities = {"robot": {"simulated": True}}
    assert is_simulated(run)
