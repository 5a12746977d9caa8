"""What installed packages bring: objects by entry points, campaigns, and files of procedures, cells and robots by name.

No other module finds shipped files. The simulators, which share no code with cellctl, find the robot files by the same
rule (`sims/robot_file.py`).
"""

from __future__ import annotations

import difflib
import logging
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, PackageNotFoundError, distribution, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, final

from cellctl.files import InputError, Problem

T = TypeVar("T")
Kind = Literal["procedure", "cell", "robot"]

CAMPAIGNS = "cellctl.campaigns"
"""The entry point group: name = any, value = a `Campaigns`. The files of its package are the shipped ones."""

OBJECTS: Mapping[str, str] = {
    "cellctl.devices": "DriverDescription",
    "cellctl.simulators": "Simulator",
    "cellctl.steps": "module",
    "cellctl.report_sections": "ReportSection",
    "cellctl.scene_sources": "SceneSource",
    "cellctl.commissioning": "CellSteps",
    "cellctl.campaigns": "Campaigns",
    "cellctl.effects": "ABCMeta",
    "cellctl.row_kinds": "RowKind",
    "cellctl.compensation_methods": "Method",
}
"""Entry point group → the name of the class of its objects. Most of them are imported where they are used alone."""

_FOLDERS: dict[Kind, tuple[str, ...]] = {
    "procedure": (".", "papers"),
    "cell": ("cells", "papers/cells"),
    "robot": ("robots",),
}
"""Folders of such a package that hold YAML files of this kind."""


def contributions(group: str, kind: type[T], what: str, broken: list[str]) -> Iterator[tuple[str, T]]:
    """Each object that is registered in an entry point group, with its label, by name.

    What cannot be loaded, or is no `kind`, is added to `broken` as text. what: the noun of label and texts.
    """
    yield from ((label, found) for _, label, found in named_contributions(group, kind, what, broken))


def named_contributions(group: str, kind: type[T], what: str, broken: list[str]) -> Iterator[tuple[str, str, T]]:
    """As `contributions`, with the name of each."""
    for name, value, point in sorted((point.name, point.value, point) for point in entry_points(group=group)):
        label = f"{what} '{name}' ({value})"
        try:
            found = point.load()
        except Exception as error:  # the code of another package may raise anything
            broken.append(f"{label} cannot be loaded: {error}")
            continue
        if isinstance(found, kind):
            yield name, label, found
        else:
            broken.append(f"{label} is no {kind.__name__}")


def names_in(group: str) -> frozenset[str]:
    """The names in an entry point group."""
    return frozenset(point.name for point in entry_points(group=group))


def points_of(package: str) -> list[EntryPoint]:
    """The entry points of an installed package in groups of cellctl, by group and name. Raises InputError."""
    try:
        points = distribution(package).entry_points
    except (PackageNotFoundError, ValueError) as error:
        cure = "install it: pip install -e FOLDER; `pip list` has the names"
        raise InputError(Problem(package, 0, 0, "is no installed package", cure)) from error
    ours = sorted(
        (each for each in points if each.group.startswith("cellctl.")), key=lambda each: (each.group, each.name)
    )
    if not ours:
        cure = "a change of pyproject.toml counts after the package is installed again"
        raise InputError(Problem(package, 0, 0, "has no entry point in a group `cellctl.…`", cure))
    return ours


def files_beside(modules: Collection[str], kind: Kind) -> list[Path]:
    """The YAML files of that kind in the folders of these packages."""
    return sorted(
        file for place in _places(modules) for name in _FOLDERS[kind] for file in (place / name).glob("*.yaml")
    )


def examples() -> Path:
    """The folder of the example packages: in the installed package, or `docs/examples` of the source tree."""
    inside = Path(__file__).with_name("examples")
    return inside if inside.is_dir() else Path(__file__).parents[1] / "docs" / "examples"


def has_package(name: str) -> bool:
    """Whether a package of that name can be imported."""
    return find_spec(name) is not None


class Compared(Protocol):
    """The runs of a series that were compared."""

    def to_json(self) -> dict[str, Any]:
        """What the route of the console's API answers."""


@final
@dataclass(frozen=True, kw_only=True)
class History:
    """The runs of one kind of campaign, compared over time: a page of the console and a route of its API.

    name: of the page, `/name`, and of the route, `/api/name`. title: of the page, and in the navigation. about: the
    route's description. entry: what is kept of a finished run (its `RunState`), None for a run of another kind: the
    series of runs that it is compared with (any text), the title of that, and its content as JSON. compare: compares
    the runs of a series, name and content of each, oldest first, in a thread; its number is of the first runs, which
    give the limits, None: as their procedure says. view: is called for each page that is opened, in its content, and
    returns what shows that which `compare` gave, again after each change.
    """

    name: str
    title: str
    about: str
    entry: Callable[[Any], tuple[str, str, Mapping[str, Any]] | None]
    compare: Callable[[Sequence[tuple[str, Mapping[str, Any]]], int | None], Compared]
    view: Callable[[], Callable[[Any], None]]


@final
@dataclass(frozen=True, kw_only=True)
class Campaigns:
    """What a package of campaigns states of them. first: the name of the procedure to offer first; empty: none.

    checks: procedure → the devices, besides the robot, of the new cell files that are checked with it.
    """

    first: str = ""
    histories: tuple[History, ...] = ()
    checks: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


@cache
def _campaigns() -> tuple[Campaigns, ...]:
    """Of all installed packages; a warning names what cannot be used."""
    broken: list[str] = []
    found = tuple(each for _, each in contributions(CAMPAIGNS, Campaigns, "campaigns", broken))
    for text in broken:
        logging.getLogger(__name__).warning(text)
    return found


def histories() -> tuple[History, ...]:
    """The histories of all installed campaigns."""
    return tuple(history for each in _campaigns() for history in each.histories)


def first_procedure() -> str:
    """The name of the procedure to offer first; empty: no package states one."""
    return next((each.first for each in _campaigns() if each.first), "")


def checks_of(devices: Collection[str]) -> tuple[str, ...]:
    """The procedures that a new cell file with these devices is checked with."""
    return tuple(name for each in _campaigns() for name, needed in each.checks.items() if set(needed) <= set(devices))


@cache
def _folders() -> tuple[Path, ...]:
    """Of the packages with campaigns, by name. They are not imported."""
    return tuple(_places(sorted({point.module.partition(".")[0] for point in entry_points(group=CAMPAIGNS)})))


def _places(modules: Collection[str]) -> Iterator[Path]:
    for spec in filter(None, map(find_spec, modules)):
        yield from map(Path, spec.submodule_search_locations or ())


def shipped(kind: Kind) -> dict[str, Path]:
    """Name → file of all shipped files of that kind, sorted by name in each folder; of two with one name the first.

    A name is a file's name without folder and suffix.
    """
    found: dict[str, Path] = {}
    for folder in (package / name for name in _FOLDERS[kind] for package in _folders()):
        for file in sorted(folder.glob("*.yaml")):
            found.setdefault(file.stem, file)
    return found


def shipped_file(kind: Kind, given: Path) -> Path:
    """`given` itself if it is a path, else the shipped file of that name.

    An existing file has priority; a text with a folder or a suffix is a path. The result is relative if the shipped
    files are below the working folder. Raises InputError for a name that is neither a file nor shipped.
    """
    if given.is_file() or given.suffix or len(given.parts) != 1:
        return given
    names = shipped(kind)
    if given.name not in names:
        what = f"is no file, and no shipped {kind} has this name"
        cure = near(given.name) if kind == "robot" else f"one of: {', '.join(names)}"
        raise InputError(Problem(str(given), 0, 0, what, f"give a path, or {cure}"))
    file, here = names[given.name], Path.cwd()
    return file.relative_to(here) if file.is_relative_to(here) else file


def robot_file(model: str, folder: Path) -> Path:
    """The robot file that `model`, the text in a file in `folder`, means: a path from `folder`, or a library name.

    An existing file has priority. A text that is neither is returned as a path from `folder`.
    """
    path = folder / model
    return path if path.is_file() else shipped("robot").get(model, path)


def cell_file(cell: str, folder: Path) -> Path:
    """The cell file that `cell`, the text in a procedure in `folder`, means: a path from `folder`, or a shipped name.

    An existing file has priority. A text that is neither is returned as a path from `folder`.
    """
    path = folder / cell
    return path if path.is_file() else shipped("cell").get(cell, path)


def near(name: str) -> str:
    """A cure for an unknown robot `name`: names that begin like it, the nearest ones, the command that lists all."""
    library = shipped("robot")
    begin = [known for known in library if known.startswith(name.lower())]
    found = list(dict.fromkeys([*begin, *difflib.get_close_matches(name.lower(), library, cutoff=0.5)]))[:3]
    listed = "cellctl robots lists the library"
    return f"did you mean {' or '.join(found)}? {listed}" if found else listed
