"""An installed wheel works in any folder, by the names of what it ships; folders named as our packages do no harm."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from cell_runs import PATIENCE_S, ROOT

CELLCTL = "import cellctl, sys; sys.argv[0] = 'cellctl'; from cellctl.cli.main import main; main()"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this tree, unpacked as an installer does."""
    folder = tmp_path_factory.mktemp("wheel")
    build = ["uv", "build", "--wheel", "--offline", "--out-dir", str(folder), str(ROOT)]
    done = subprocess.run(build, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel:
        wheel.extractall(folder / "site")
    return folder / "site"


@pytest.fixture(params=["empty", "names of ours"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param != "empty":
        for name in ("sims", "drivers", "procedures"):
            (tmp_path / name).mkdir()
            (tmp_path / name / "__init__.py").write_text("raise ImportError('not the one that is meant')\n")
    return tmp_path


def cellctl(installed: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, "-P", "-c", CELLCTL, *words]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


@pytest.mark.long
def test_a_shipped_procedure_is_checked_by_its_name(installed: Path, folder: Path) -> None:
    done = cellctl(installed, folder, "check", "sphere_selfcal", "--cell", "sphere_cell")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{installed}/procedures/sphere_selfcal.yaml: no errors found")


@pytest.mark.long
@pytest.mark.campaign
def test_a_shipped_procedure_runs_by_its_name(installed: Path, folder: Path) -> None:
    few = ["--set", "touches_fit=12", "--set", "touches_test=5"]
    done = cellctl(installed, folder, "run", "sphere_single", *few)
    assert done.returncode in (0, 1), done.stderr
    assert list((folder / "runs").glob("*/report.html"))


def test_shipped_names_are_those_of_the_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from cellctl.files import InputError
    from cellctl.operations.shipped import shipped_file

    monkeypatch.chdir(tmp_path)
    assert shipped_file("robot", Path("ur10")) == ROOT / "procedures" / "robots" / "ur10.yaml"
    assert shipped_file("cell", Path("sphere_cell.yaml")) == Path("sphere_cell.yaml")
    Path("ur10").write_text("my own")
    assert shipped_file("robot", Path("ur10")) == Path("ur10")
    with pytest.raises(InputError, match="one of: iiwa14, kr5_r1400, ur10"):
        shipped_file("robot", Path("ur11"))
