"""Files to be written: looked at before the work, not after it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cellctl.files import InputError, Problem


def refuse_outputs(outputs: Mapping[str, Path | str | None], inputs: Sequence[Path | None]) -> None:
    """Raise InputError where an output (by its option; None and `-` are none) cannot be a file, is one of the `inputs`,
    or is given twice.
    """
    wanted = {option: Path(path) for option, path in outputs.items() if path is not None and str(path) != "-"}
    read = {path.resolve() for path in inputs if path is not None}
    problems, taken = [], dict[Path, str]()
    for option, path in wanted.items():
        if (what := _why_not(path, read, taken)) is not None:
            problems.append(Problem(str(path), 0, 0, what, f"give {option} another file"))
        taken.setdefault(path.resolve(), option)
    if problems:
        raise InputError(problems)


def _why_not(path: Path, read: set[Path], taken: Mapping[Path, str]) -> str | None:
    if path.is_dir():
        return "is a folder"
    if not path.parent.is_dir():
        return "lies in a folder that is not there"
    if path.resolve() in read:
        return "is read here: it would be written over"
    return f"is written by {taken[path.resolve()]} as well" if path.resolve() in taken else None
