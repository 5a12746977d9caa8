"""Study files: what is fitted or run, over which factors and seeds; checked before anything is computed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, TypeAlias, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.files import Document, InputError, Problem, load_yaml
from cellctl.files.validated import validated
from cellctl.operations.studies import campaign_units, fit_units
from cellctl.operations.studies.runner import Measure, Row, each

Value: TypeAlias = bool | int | float | str

SEED = "seed"
MOST_UNITS = 1_000_000


@final
@dataclass(frozen=True)
class Kind:
    """What one unit does. settings: name → default value (None: it has to be stated); measure: computes a unit; check:
    raises InputError for settings that cannot be used; plotted: figures of the page; open: begins the names of further
    settings.
    """

    settings: Mapping[str, Any]
    measure: Measure
    check: Any
    plotted: tuple[str, ...]
    open: str = ""


KINDS = {
    "fit": Kind(fit_units.SETTINGS, fit_units.measure, fit_units.check, fit_units.PLOTTED),
    "campaign": Kind(
        campaign_units.SETTINGS, campaign_units.measure, campaign_units.check, campaign_units.PLOTTED, "set."
    ),
}


class _Seeds(BaseModel):
    """count of seeds from the `first` one."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    count: int = Field(ge=1)
    first: int = Field(default=1, ge=0)


class StudyContent(BaseModel):
    """A study as in its file."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", frozen=True)
    study: Literal["fit", "campaign"]
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,60}$")
    settings: dict[str, Value] = {}
    factors: dict[str, list[Value]] = {}
    points: list[dict[str, Value]] = []
    seeds: _Seeds = _Seeds(count=1)
    keep: Literal["none", "failed", "all"] = "none"


@final
@dataclass(frozen=True)
class Study:
    """A study: its file, its content, and its units in order."""

    document: Document
    content: StudyContent
    units: tuple[Row, ...] = field(repr=False)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read and check a study file. Raises InputError with all errors of its settings."""
        document = load_yaml(path)
        content = validated(document, StudyContent)
        problems = list(_problems(document, content))
        if problems:
            raise InputError(problems)
        units = tuple(_units(content))
        folder, found = path.resolve().parent, []
        for point in {tuple((k, v) for k, v in unit.items() if k != SEED): unit for unit in units}.values():
            try:
                KINDS[content.study].check(folder, point)
            except InputError as error:
                found += [each for each in error.problems if each not in found]
        if found:
            raise InputError(found)
        return cls(document, content, units)

    @property
    def kind(self) -> Kind:
        """What a unit does."""
        return KINDS[self.content.study]

    @property
    def varied(self) -> tuple[str, ...]:
        """The settings that have several values, in the order of the file."""
        names = dict.fromkeys([*self.content.factors, *(name for point in self.content.points for name in point)])
        return tuple(name for name in names if len({repr(unit[name]) for unit in self.units}) > 1)


def _units(content: StudyContent) -> Iterator[Row]:
    """The full product of the factors, at each of the listed points, for each seed."""
    given = {**KINDS[content.study].settings, **content.settings}
    seeds = range(content.seeds.first, content.seeds.first + content.seeds.count)
    for point in content.points or [{}]:
        for values in each(**content.factors):
            for seed in seeds:
                yield {**given, **point, **values, SEED: seed}


def _problems(document: Document, content: StudyContent) -> Iterator[Problem]:
    kind, stated = KINDS[content.study], {*content.settings, *content.factors}
    for place, names in (("settings", content.settings), ("factors", content.factors)):
        for name in names:
            if problem := _unknown(document, (place, name), kind):
                yield problem
            if place == "factors" and not content.factors[name]:
                yield document.problem((place, name), "has no value", "list one value or more")
            if place == "factors" and len(set(map(repr, content.factors[name]))) < len(content.factors[name]):
                yield document.problem((place, name), "has a value twice", "list each value once; seeds repeat a point")
    for number, point in enumerate(content.points):
        for name in point:
            if problem := _unknown(document, ("points", number, name), kind):
                yield problem
            if name in content.factors:
                what = f"'{name}' is a factor, too"
                yield document.problem(("points", number, name), what, "state it in factors or in points", key=True)
        if point.keys() != content.points[0].keys():
            what = "has other names than the first point"
            yield document.problem(("points", number), what, "give each point a value for every name")
        if point in content.points[:number]:
            yield document.problem(("points", number), "is there twice", "list each point once; seeds repeat it")
    stated |= {name for point in content.points for name in point}
    for name, default in kind.settings.items():
        if default is None and name not in stated:
            yield document.problem((), f"{name} is not stated", f"write it in settings or factors: {name}: …")
    count = content.seeds.count * max(len(content.points), 1)
    for values in content.factors.values():
        count *= max(len(values), 1)
    if count > MOST_UNITS:
        yield document.problem((), f"has {count} units", f"at most {MOST_UNITS}: fewer values, points or seeds")


def _unknown(document: Document, at: tuple[Any, ...], kind: Kind) -> Problem | None:
    name = at[-1]
    if name in kind.settings or (kind.open and name.startswith(kind.open)):
        return None
    known = ", ".join([*kind.settings, *([f"{kind.open}NAME"] if kind.open else [])])
    return document.problem(at, f"'{name}' is no setting of this kind of study", f"one of: {known}", key=True)
