"""An installed wheel works in any folder, by the names of what it ships; folders named as our packages do no harm."""

import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tests.helpers.runs import PATIENCE_S, ROOT


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual environment with the wheel of this tree, installed by an installer; dependencies are this one's."""
    folder = tmp_path_factory.mktemp("wheel")
    environment = folder / "venv"
    uv("build", "--wheel", "--out-dir", folder, ROOT)
    uv("venv", "--python", sys.executable, environment)
    uv("pip", "install", "--no-deps", "--python", environment / "bin" / "python", next(folder.glob("*.whl")))
    site = next(environment.glob("lib/python*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")  # behind the wheel's own packages
    return environment


def uv(*words: object) -> None:
    command = ["uv", *map(str, words), "--offline"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(params=["empty", "names of ours"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param != "empty":
        for name in ("sims", "drivers", "procedures"):
            (tmp_path / name).mkdir()
            (tmp_path / name / "__init__.py").write_text("raise ImportError('not the one that is meant')\n")
    return tmp_path


def ended(folder: Path, *command: object) -> subprocess.CompletedProcess[str]:
    words = [str(word) for word in command]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


@pytest.mark.long
@pytest.mark.parametrize("start", [["bin/cellctl"], ["bin/python", "-m", "cellctl"]], ids=["script", "module"])
def test_a_shipped_procedure_is_checked_by_its_name(installed: Path, folder: Path, start: list[str]) -> None:
    done = ended(folder, installed / start[0], *start[1:], "check", "sphere_selfcal", "--cell", "sphere_cell")
    assert done.returncode == 0, done.stderr
    (site,) = installed.glob("lib/python*/site-packages")
    assert done.stdout.startswith(f"{site}/procedures/sphere_selfcal.yaml: no errors found")


@pytest.mark.long
@pytest.mark.campaign
def test_the_shipped_campaign_runs_by_its_name_in_an_empty_folder(installed: Path, tmp_path: Path) -> None:
    few = ("touches_fit=24", "touches_test=8", "standoff_targets=12", "reference_every=12")
    settings = [word for setting in few for word in ("--set", setting)]
    done = ended(tmp_path, installed / "bin" / "cellctl", "run", "sphere_selfcal", *settings)
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "runs").glob("*/report.html"))


@pytest.mark.long
@pytest.mark.campaign
@pytest.mark.parametrize("folder", ["names of ours"], indirect=True)
def test_a_shipped_procedure_runs_beside_folders_named_as_our_packages(installed: Path, folder: Path) -> None:
    few = ["--set", "touches_fit=12", "--set", "touches_test=5"]
    done = ended(folder, installed / "bin" / "python", "-m", "cellctl", "run", "sphere_single", *few)
    assert done.returncode in (0, 1), done.stderr
    assert list((folder / "runs").glob("*/report.html"))


def test_shipped_names_are_those_of_the_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from cellctl.files import InputError
    from cellctl.installed import shipped_file

    monkeypatch.chdir(tmp_path)
    assert shipped_file("robot", Path("ur10")).resolve() == ROOT / "procedures" / "robots" / "ur10.yaml"
    papers = ROOT / "procedures" / "papers"
    assert shipped_file("procedure", Path("spherical_constraint")).resolve() == papers / "spherical_constraint.yaml"
    assert shipped_file("cell", Path("tx60_pose_cell")).resolve() == papers / "cells" / "tx60_pose_cell.yaml"
    assert shipped_file("cell", Path("sphere_cell.yaml")) == Path("sphere_cell.yaml")
    Path("ur10").write_text("my own")
    assert shipped_file("robot", Path("ur10")) == Path("ur10")
    with pytest.raises(InputError, match="did you mean ur10"):
        shipped_file("robot", Path("ur11"))
