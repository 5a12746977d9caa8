"""The example packages, and all that `cellctl new` makes, are built, installed and tested outside the source tree."""

import subprocess
import sys
import sysconfig

import pytest

from tests.helpers.examples import EXAMPLES
from tests.helpers.runs import PATIENCE_S, ROOT

NEW = {
    "driver": "laser_gap",
    "simulator": "wire_gauge",
    "campaign": "step_gauge",
    "effect": "sag",
    "row-kind": "depth",
    "method": "halved",
}
"""Kind → name. All are in one environment: what two of them name alike would be found."""


def ended(*command: object, folder=ROOT):
    words = list(map(str, command))
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """A folder with a virtual environment `venv` that has cellctl and the packages as wheels, and the packages' own
    folders; other dependencies are this environment's.
    """
    folder = tmp_path_factory.mktemp("new")
    python = folder / "venv" / "bin" / "python"
    ended("uv", "build", "--wheel", "--offline", "--out-dir", folder / "wheels", ROOT)
    ended("uv", "venv", "--offline", "--python", sys.executable, folder / "venv")
    install = ("uv", "pip", "install", "--offline", "--no-deps", "--python", python)
    ended(*install, next((folder / "wheels").glob("cellctl*.whl")))
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")  # behind the wheel's own packages
    for kind, name in NEW.items():
        ended(python, "-m", "cellctl", "new", kind, name, folder=folder)
    ended(*install, *_projects(folder))
    return folder


def _projects(folder):
    return [*(EXAMPLES / name for name in ("dial_gauge", "calibration_kit")), *(folder / name for name in NEW.values())]


@pytest.mark.long
@pytest.mark.campaign
def test_the_tests_of_every_package_pass(environment):
    words = ["-q", "-p", "no:cacheprovider", "--import-mode=importlib", "--rootdir", environment / "wheels"]
    tests = [project / "tests" for project in _projects(environment)]
    told = ended(environment / "venv" / "bin" / "python", "-m", "pytest", *words, *tests, folder=environment / "wheels")
    assert "passed" in told
    assert "skipped" not in told


@pytest.mark.long
def test_an_installed_driver_reports_the_health_of_its_simulated_device(environment):
    cell = environment / "laser_gap" / "laser_gap" / "cells" / "laser_gap_cell.yaml"
    told = ended(environment / "venv" / "bin" / "cellctl", "doctor", cell, folder=environment)
    assert "SIM-GAUGE-1" in told
