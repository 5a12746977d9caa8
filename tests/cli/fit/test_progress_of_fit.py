"""What a fit says while it runs: how far it is and how long it takes, on stderr, and nothing if it is short."""

import json
import sys

import pytest

from cellctl.calibration.identification.progress import part_of
from cellctl.cli.fit_progress import shown_progress
from cellctl.operations.pace import time_left


def test_a_short_fit_says_nothing(capsys):
    with shown_progress("fit") as progress:
        progress("geometry", 0.1)
    assert capsys.readouterr().err == ""


def test_elsewhere_than_on_a_terminal_a_long_one_says_so_in_plain_lines(capsys):
    now = [0.0]
    with shown_progress("fit", lambda: now[0]) as progress:
        for doing, share in (("geometry", 0.0), ("compliance", 0.1), ("harmonics", 0.2), ("backlash", 0.5)):
            progress(doing, share)
            now[0] += 4.0
    assert capsys.readouterr().err.splitlines() == [
        "fit: 10 %, compliance, 36 s left",
        "fit: 50 %, backlash, 12 s left",
    ]


def test_on_a_terminal_it_is_a_bar_on_stderr(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("FORCE_COLOR", "1")
    now = [0.0]
    with shown_progress("fit", lambda: now[0]) as progress:
        now[0] = 30.0
        progress("compliance", 0.25)
    said = capsys.readouterr()
    assert "compliance" in said.err
    assert "1 min 30 s left" in said.err
    assert said.out == ""


@pytest.mark.parametrize(("seconds", "share", "words"), [(1, 0.01, ""), (60.0, 0.5, "1 min 00 s left"), (9.0, 1.0, "")])
def test_the_time_left_is_reported_where_it_can_be(seconds, share, words):
    assert time_left(seconds, share) == words


def test_a_part_of_the_work_knows_nothing_of_the_rest():
    told = []
    part_of(lambda *each: told.append(each), 0.5, 0.75, "fold 2 of 3")("geometry", 0.5)
    assert told == [("fold 2 of 3: geometry", 0.625)]


def test_json_on_stdout_stays_clean(cellctl, files, capsys, monkeypatch):
    monkeypatch.setattr("cellctl.cli.fit_progress.QUIET_S", 0.0)
    cellctl("fit", files / "robot.yaml", files / "positions.csv", "--model", "registration", "--json", "-")
    said = capsys.readouterr()
    assert json.loads(said.out)["verdict"]
    assert "fit: 0 %, identifying" in said.err
