"""An older model of the elbow arm, made at the command line, for work that goes on from it."""

import re
from pathlib import Path

import pytest

from cellctl.cli import ends
from cellctl.cli.verbs import app
from tests.helpers.arms import ROBOT


def cellctl(*words: object) -> int:
    """The exit code of a call of the command line."""
    return ends.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


def printed_errors(capsys: pytest.CaptureFixture[str]) -> str:
    """The errors that a call printed, without their number; progress of a slow call comes before them."""
    return re.split(r"cellctl: \d+ errors?\n", capsys.readouterr().err)[-1].strip()


def identified(folder: Path, before: str) -> Path:
    """`folder` with the robot file, and with `model.json` identified from the data set `before`."""
    (folder / "robot.yaml").write_text(ROBOT)
    (folder / "before.csv").write_text(before)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert cellctl("fit", "robot.yaml", "before.csv", "--model", "geometry", "--out", "model.json") == 0
    return folder
