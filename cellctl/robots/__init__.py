"""The library of nominal robots, found by name: the robot files that are shipped in `procedures/robots`.

A name is a file's name without folder and suffix. The simulators, which share no code with cellctl, find the same files
by the same rule (`sims/robot_file.py`).
"""

from __future__ import annotations

import difflib
from importlib.util import find_spec
from pathlib import Path

_PACKAGE = "procedures"


def library() -> dict[str, Path]:
    """Name → robot file, sorted by name."""
    return shipped("robots")


def shipped(folder: str) -> dict[str, Path]:
    """Name → YAML file in a folder of the package `procedures`, sorted by name."""
    spec = find_spec(_PACKAGE)
    places = (spec.submodule_search_locations or ()) if spec else ()
    return {file.stem: file for place in places for file in sorted((Path(place) / folder).glob("*.yaml"))}


def robot_file(model: str, folder: Path) -> Path:
    """The robot file that `model`, the text in a file in `folder`, means: a path from `folder`, or a library name.

    An existing file has priority. A text that is neither is returned as a path from `folder`.
    """
    path = folder / model
    return path if path.is_file() else library().get(model, path)


def near(name: str) -> str:
    """A cure for an unknown `name`: names that begin like it, the nearest ones, and the command that lists all."""
    begin = [known for known in library() if known.startswith(name.lower())]
    found = list(dict.fromkeys([*begin, *difflib.get_close_matches(name.lower(), library(), cutoff=0.5)]))[:3]
    listed = "cellctl robots lists the library"
    return f"did you mean {' or '.join(found)}? {listed}" if found else listed
