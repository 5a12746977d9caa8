"""Folders of the working directory that have the names of our packages are nobody's packages."""

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture
def folder(tmp_path):
    for name in ("sims", "drivers", "procedures"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('of another project')\n")
    return tmp_path


@pytest.mark.long
def test_check_takes_its_own_simulators_drivers_and_steps(request, folder):
    cellctl = Path(sys.executable).parent / "cellctl"
    procedure = request.config.rootpath / "procedures/sphere_single.yaml"
    done = subprocess.run(
        [cellctl, "check", procedure], cwd=folder, capture_output=True, text=True, timeout=90, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "no errors found" in done.stdout
