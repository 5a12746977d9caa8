"""`check` refuses what `run` would refuse only once its devices are connected; `run` then connects none."""

from pathlib import Path

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from tests.helpers.runs import CELL, ROOT, SELFCAL, cell_with

ROBOT = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"


def cellctl(*words: object) -> int:
    return exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


@pytest.mark.parametrize("verb", ["check", "run"])
@pytest.mark.parametrize(
    ("settings", "changes", "words"),
    [
        (["identify_on=S1, S2, S9"], {}, "there is no sphere 'S9'"),
        (["prove_on=P2"], {}, "there is no sphere 'P2'"),
        ([], {"mm: 700.412": "mm: 7004.12"}, "7004.12 mm, but the rough places of S1 and S2 are 700.0 mm apart"),
        ([], {"mm: 700.412, sigma: 0.01": "mm: 700.412, sigma: 0"}, "sigma"),
        ([], {"centre: [1150, 0, 400]": "centre: [3150, 0, 400]"}, "rough places of S2 and S3"),
        ([], {"centre: [850, 0, 550]": "centre: [2850, 0, 550]"}, "touches on sphere P1 can be reached"),
    ],
    ids=["sphere to identify on", "sphere to prove on", "spacing", "zero sigma", "far sphere", "proof out of reach"],
)
def test_an_error_in_the_cell_is_refused_before_anything_connects(
    settings: list[str],
    changes: dict[str, str],
    words: str,
    verb: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    cell = cell_with(tmp_path, replace=changes) if changes else CELL
    options = [part for setting in settings for part in ("--set", setting)]
    assert cellctl(verb, SELFCAL, "--cell", cell, *options) == 2
    assert words in capsys.readouterr().err
    assert not Path("runs").exists()


def test_an_error_in_the_robot_file_is_refused_by_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = tmp_path / "robot.yaml"
    robot.write_text(ROBOT.read_text().replace("repeatability:", "repeatabillity:"))
    cell = cell_with(tmp_path, replace={f"{ROOT}/procedures/robots/kr5_r1400.yaml": str(robot)})
    assert cellctl("check", SELFCAL, "--cell", cell) == 2
    assert "robot.yaml" in capsys.readouterr().err
