"""Options of `run` that would be silently ignored are refused; a run that never began is to be started again."""

from pathlib import Path

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from tests.helpers.runs import SELFCAL


def cellctl(*words: object) -> int:
    return exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--acknowledge"], "--acknowledge: goes with a run that is resumed"),
        (["--resume", "r", "--seed", "3"], "--seed: a resumed run keeps"),
        (["--resume", "r", "--clock", "realtime"], "--clock: a resumed run keeps"),
    ],
)
def test_an_option_without_effect_is_refused(
    options: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cellctl("run", SELFCAL, *options) == 2
    assert words in capsys.readouterr().err
    assert not Path("runs").exists()


@pytest.mark.parametrize("left", [[], ["journal.lock", "simulated_cell.json"]], ids=["at once", "a little later"])
def test_a_run_that_was_killed_before_its_journal_is_to_be_started_again(
    left: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "runs" / "killed"
    run.mkdir(parents=True)
    for name in left:
        (run / name).touch()
    assert cellctl("run", SELFCAL, "--runs", tmp_path / "runs", "--resume", "killed") == 2
    said = capsys.readouterr().err
    assert f"{run}: this run ended before it began: nothing was moved\n    start again: cellctl run {SELFCAL}" in said


def test_a_folder_that_is_no_run_is_not_said_to_have_moved_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "letter.txt").write_text("Dear")
    assert cellctl("run", SELFCAL, "--resume", tmp_path) == 2
    said = capsys.readouterr().err
    assert "there is no journal" in said
    assert "nothing was moved" not in said
