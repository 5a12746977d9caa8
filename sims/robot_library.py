"""The shipped robot files, by name: data beside the procedures, read without their code."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path


def robot_path(model: str, folder: Path) -> Path:
    """The robot file that `model`, in a cell file in `folder`, means: a path from there, else a shipped name."""
    path = folder / model
    spec = find_spec("procedures")
    shipped = [Path(place) / "robots" / f"{model}.yaml" for place in (spec and spec.submodule_search_locations) or ()]
    return next((file for file in (path, *shipped) if file.is_file()), path)
