"""Makes the package of an extension from one of the example packages (`docs/examples`), with its names replaced.

The examples are the only source: what a new package has is tested with them.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from keyword import iskeyword
from pathlib import Path
from typing import final

from cellctl.files import InputError, Problem
from cellctl.installed import examples, has_package, names_in

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_ENTRY_POINTS = re.compile(r'^\[project\.entry-points\."[^"]+"\]\n(?:.+\n)+\n?', re.MULTILINE)
_VALUE = re.compile(r'= "([\w.]+)')


@final
@dataclass(frozen=True)
class Skeleton:
    """Which files of an example a new package has, and how they name the thing itself (`snake_case`).

    example: the folder, and its package. files: patterns below the folder, besides `pyproject.toml` and the package's
    `__init__.py`.
    """

    example: str
    thing: str
    files: tuple[str, ...]


_CELL = "dial_gauge/cells/*"
KINDS: Mapping[str, Skeleton] = {
    "driver": Skeleton("dial_gauge", "dial_gauge", ("*/driver.py", "*/simulator.py", _CELL, "tests/test_[ds]*.py")),
    "simulator": Skeleton("dial_gauge", "dial_gauge", ("*/simulator.py", _CELL, "tests/test_simulator.py")),
    "campaign": Skeleton("dial_gauge", "dial_gauge", ("*/*.py", "*/*.yaml", _CELL)),
    "effect": Skeleton("calibration_kit", "tool_heat", ("*/effect.py", "tests/test_effect.py")),
    "row-kind": Skeleton("calibration_kit", "height", ("*/row_kind.py", "tests/test_row_kind.py")),
    "method": Skeleton("calibration_kit", "damped", ("*/method.py", "tests/test_method.py")),
}
"""What `cellctl new` makes; a campaign comes with a device of its own."""


def new_package(kind: str, name: str, folder: Path) -> tuple[Path, ...]:
    """Write a package called `name` into `folder`, new or empty; its files. Raises InputError."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(Problem(str(folder), 0, 0, "is there already", "give -o a new or empty folder"))
    _check_name(name)
    skeleton = KINDS[kind]
    texts = {renamed(file, skeleton, name): renamed(text, skeleton, name) for file, text in _chosen(skeleton).items()}
    _refuse_taken(name, texts["pyproject.toml"])
    try:
        for file, text in texts.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_text(text, encoding="utf-8")
    except OSError as error:
        what = f"could not be written: {error.strerror or error}"
        raise InputError(Problem(str(error.filename or folder), 0, 0, what, "give -o another folder")) from error
    return tuple(folder / file for file in sorted(texts))


def renamed(text: str, skeleton: Skeleton, name: str) -> str:
    """`text` of an example with the names of its package and its thing replaced, in every way of writing them."""
    forms: dict[str, str] = {}
    for word in (skeleton.thing, skeleton.example):
        forms |= dict(zip(_forms(word), _forms(name), strict=True))
    longest_first = sorted(forms, key=len, reverse=True)
    return re.sub("|".join(map(re.escape, longest_first)), lambda found: forms[found[0]], text)


def _forms(name: str) -> tuple[str, ...]:
    """In sentences, classes, distributions and identifiers; where two are equal the last counts."""
    words = name.split("_")
    return (" ".join(words).capitalize(), "".join(map(str.capitalize, words)), " ".join(words), "-".join(words), name)


def _chosen(skeleton: Skeleton) -> dict[str, str]:
    """File → text of the example's files that the new package has; its entry points are of these alone."""
    example = examples() / skeleton.example
    patterns = ("pyproject.toml", f"{skeleton.example}/__init__.py", *skeleton.files)
    files = sorted({file for pattern in patterns for file in example.glob(pattern) if file.is_file()})
    texts = {file.relative_to(example).as_posix(): file.read_text(encoding="utf-8") for file in files}

    def kept(table: re.Match[str]) -> str:
        modules = (value.replace(".", "/") + ".py" for value in _VALUE.findall(table[0]))
        return table[0] if all(module in texts for module in modules) else ""

    texts["pyproject.toml"] = _ENTRY_POINTS.sub(kept, texts["pyproject.toml"])
    return texts


def _check_name(name: str) -> None:
    """Raise InputError for a name that no new package can have."""
    if not _NAME.fullmatch(name) or iskeyword(name):
        raise InputError(Problem(name, 0, 0, "cannot be the name of a package", "as dial_gauge: a-z, 0-9 and _"))
    if name in sys.stdlib_module_names or has_package(name):
        raise InputError(Problem(name, 0, 0, "is the name of an installed package", "give another name"))


def _refuse_taken(name: str, pyproject: str) -> None:
    """Raise InputError if an entry point of the new package is installed already."""
    for group, points in tomllib.loads(pyproject)["project"]["entry-points"].items():
        if taken := sorted(points.keys() & names_in(group)):
            raise InputError(Problem(name, 0, 0, f"'{taken[0]}' is taken in {group}", "give another name"))
