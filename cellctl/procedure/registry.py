"""Finds step kinds in modules named by entry points, each loaded at its first use; titles and fields that they give.

A module holds step kinds, or describes them in its tuple `STEPS`: then a function is imported only when it is to run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pkgutil import walk_packages
from types import ModuleType
from typing import Self, final

from cellctl.procedure._steps import AnyStepKind, StepDescription, StepKind
from cellctl.procedure.fields import did_you_mean
from cellctl.procedure.model import Action, If, Loop, Procedure, Step, walk

GROUP = "cellctl.steps"
"""The entry point group: name = the family of steps, value = the module that holds them."""


class UnknownStep(LookupError):
    """No step kind has that name. `cure` suggests a similar one."""

    def __init__(self, name: str, cure: str) -> None:
        self.name = name
        self.cure = cure
        super().__init__(f"there is no step '{name}'\n    {cure}")


class BrokenSteps(Exception):
    """A module of steps is unusable: its import fails, or it does not match its entry point."""

    def __init__(self, source: str, why: str) -> None:
        self.source = source
        self.why = why
        super().__init__(f"the steps of {source} cannot be loaded: {why}")


@final
class StepRegistry:
    """Kinds of steps by name. `families`: family → what loads its module."""

    def __init__(
        self, kinds: Iterable[AnyStepKind] = (), families: Mapping[str, Callable[[], ModuleType]] | None = None
    ) -> None:
        self._kinds: dict[str, AnyStepKind | StepDescription] = {kind.name: kind for kind in kinds}
        self._families = dict(families or {})
        self._loaded: dict[str, BrokenSteps | None] = {}

    @classmethod
    def installed(cls) -> Self:
        """All installed families of steps, none imported yet."""
        points: dict[str, list[EntryPoint]] = {}
        for point in entry_points(group=GROUP):
            rivals = points.setdefault(point.name, [])
            if all(rival.value != point.value for rival in rivals):  # two paths may lead to the same one
                rivals.append(point)
        return cls(families={name: _loader(*rivals) for name, rivals in points.items()})

    def find(self, name: str) -> AnyStepKind:
        """The kind of that name, its function imported. Raises UnknownStep, BrokenSteps."""
        found = self.describe(name)
        if isinstance(found, StepDescription):
            found = self._kinds[name] = self._import(found)
        return found

    def describe(self, name: str) -> AnyStepKind | StepDescription:
        """The kind of that name, or its description if no `find` has asked for it. Raises UnknownStep, BrokenSteps."""
        family = name.partition(".")[0]
        if name not in self._kinds and (broken := self._load(family)):
            raise broken
        if name not in self._kinds:
            raise UnknownStep(name, did_you_mean(name, self.names(), "no steps are installed"))
        return self._kinds[name]

    def names(self) -> list[str]:
        """Every name, sorted; families that cannot be loaded are left out."""
        for family in self._families:
            self._load(family)
        return sorted(self._kinds)

    def import_whole(self, procedure: Procedure) -> None:
        """Import every module of the families of steps in `procedure`, also those that their functions import.

        Between connecting and the end of a run nothing is then imported: an import may fail, and takes time from
        devices that wait. Raises UnknownStep, BrokenSteps.
        """
        names = {each.do for each in walk((*procedure.steps, *procedure.cleanup)) if isinstance(each, Step)}
        for name in sorted(names):
            self.find(name)
        for family in sorted({name.partition(".")[0] for name in names} & self._families.keys()):
            module = self._families[family]()
            for found in walk_packages(getattr(module, "__path__", ()), f"{module.__name__}."):
                import_module(found.name)

    def _load(self, family: str) -> BrokenSteps | None:
        if family not in self._families:
            return None
        if family not in self._loaded:
            self._loaded[family] = None
            try:
                self._take(family, self._families[family]())
            except BrokenSteps as error:
                self._loaded[family] = error
        return self._loaded[family]

    def _take(self, family: str, module: ModuleType) -> None:
        found: dict[str, AnyStepKind | StepDescription] = {**_kinds_in(module)}
        found |= {each.name: each for each in getattr(module, "STEPS", ()) if isinstance(each, StepDescription)}
        for name in found:
            if name.partition(".")[0] != family:
                raise BrokenSteps(f"{module.__name__} (family '{family}')", f"step '{name}' is not of this family")
        self._kinds.update(found)

    def _import(self, described: StepDescription) -> AnyStepKind:
        """The kind with its function. Raises BrokenSteps."""
        package = self._families[described.name.partition(".")[0]]().__name__
        source = f"{package}{described.module}"
        try:
            kinds = _kinds_in(import_module(described.module, package))
        except Exception as error:  # as in `_loader`
            raise BrokenSteps(source, f"{type(error).__name__}: {error}") from error
        if described.name not in kinds:
            raise BrokenSteps(source, f"it has no step '{described.name}'")
        return replace(kinds[described.name], title=described.title, expects=described.expects)


def _loader(point: EntryPoint, *rivals: EntryPoint) -> Callable[[], ModuleType]:
    def load() -> ModuleType:
        if rivals:
            raise BrokenSteps(_source(point), f"the family '{point.name}' is also claimed by {_source(rivals[0])}")
        try:
            module = point.load()
        except Exception as error:  # a plug-in's import may raise anything: name the plug-in
            raise BrokenSteps(_source(point), f"{type(error).__name__}: {error}") from error
        if not isinstance(module, ModuleType):
            raise BrokenSteps(_source(point), f"'{point.value}' is no module")
        return module

    return load


def _kinds_in(module: ModuleType) -> dict[str, AnyStepKind]:
    return {kind.name: kind for kind in vars(module).values() if isinstance(kind, StepKind)}


def _source(point: EntryPoint) -> str:
    package = f", package {point.dist.name} {point.dist.version}" if point.dist else ""
    return f"{point.value} (family '{point.name}'{package})"


def phase_titles(procedure: Procedure, registry: StepRegistry) -> dict[str, str]:
    """Step id → its phase: the title of the innermost loop around it that has one, else of its kind, else its id."""
    titles: dict[str, str] = {}
    _collect((*procedure.steps, *procedure.cleanup), "", registry, titles)
    return titles


def _collect(actions: tuple[Action, ...], around: str, registry: StepRegistry, titles: dict[str, str]) -> None:
    for action in actions:
        match action:
            case Loop():
                _collect(action.steps, action.title or around, registry, titles)
            case If():
                _collect((*action.then, *action.otherwise), around, registry, titles)
            case Step():
                titles[action.id] = around or registry.describe(action.do).title or action.id.replace("_", " ")


def section_of(procedure: Procedure, registry: StepRegistry) -> tuple[str, ...]:
    """The fields of the verdict rows that its steps record, each once, in order. Raises UnknownStep, BrokenSteps."""
    kinds = [registry.find(action.do) for action in walk(procedure.steps) if isinstance(action, Step)]
    return tuple(dict.fromkeys(name for kind in kinds if kind.verdict for name in kind.verdict.SECTION))
