"""The project as a package: pins agree, no registry is named, the rooms are kept apart."""

from __future__ import annotations

import re
import subprocess
import tomllib
from importlib.metadata import distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PINS = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if line and not line.startswith("#")]


def test_pip_and_uv_are_pinned_to_the_same_versions() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert sorted(project["tool"]["uv"]["constraint-dependencies"]) == sorted(PINS)


def test_what_is_installed_here_is_what_is_pinned() -> None:
    installed = {_normal(found.metadata["Name"]): found.version for found in distributions()}
    pinned = {_normal(name): version for name, _, version in (pin.partition("==") for pin in PINS)}
    assert {name: installed[name] for name in pinned.keys() & installed.keys()} == {
        name: version for name, version in pinned.items() if name in installed
    }


def test_every_dependency_is_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    groups = project["dependency-groups"].values()
    named = [*project["project"]["dependencies"], *(name for group in groups for name in group)]
    pinned = {_normal(pin.split("==")[0]) for pin in PINS}
    assert {_normal(re.split(r"[<>=!~\[ ]", name)[0]) for name in named} <= pinned


def test_no_package_registry_is_named_in_the_repository() -> None:
    pattern = "//[a-z.-]*(py" + "pi|python" + "hosted|npm" + "js|deb" + "ian)[.]"
    try:
        found = subprocess.run(["git", "grep", "-nIE", pattern], cwd=ROOT, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("git is not installed")
    if found.returncode > 1:
        pytest.skip("this is no git checkout")
    assert found.stdout == ""


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
