"""The packages of `docs/examples`, on the path with their entry points, as if they were installed."""

from __future__ import annotations

import tomllib
from pathlib import Path

from tests.helpers.runs import ROOT

EXAMPLES = ROOT / "docs" / "examples"


def paths_of(project: Path, folder: Path, more: str = "") -> list[str]:
    """The two folders that make a project's package and its entry points known; `more`: lines of `entry_points.txt`.

    An installer does no more than this; it takes seconds, and has tests of its own.
    """
    stated = tomllib.loads((project / "pyproject.toml").read_text())["project"]
    made = folder / f"{stated['name'].replace('-', '_')}-{stated['version']}.dist-info"
    made.mkdir(parents=True)
    (made / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {stated['name']}\nVersion: {stated['version']}\n")
    groups = [
        "\n".join([f"[{group}]", *(f"{name} = {value}" for name, value in points.items())])
        for group, points in stated["entry-points"].items()
    ]
    (made / "entry_points.txt").write_text("\n".join([*groups, more]))
    return [str(folder), str(project)]
