"""The choice of the identified model: `auto`, or terms by name: `geometry+compliance`, `poe+kriging:lambda=1e-3`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Self, TypeAlias, final

import numpy as np

from cellctl.calibration import Effect, EffectInputs, Postures, RobotModel, kinds
from cellctl.calibration.model.learnt_map import LearntMap
from cellctl.files import InputError, Problem
from cellctl.robot_file import RobotFile

ModelChoice: TypeAlias = str
"""`auto`, `registration`, or terms joined by `+`, in any order: geometry (poe: with the joints' axes in place of the
file's table; zeros: joint zeros alone), effects, and error maps, which may have settings: `kriging:weights=equal`.
"""

POE = "poe"
_ALONE = ("auto", "registration")
_TABLE = ("geometry", POE, "zeros")


@final
@dataclass(frozen=True, slots=True)
class ModelTerms:
    """A parsed model choice; the terms in the order of model names; maps: the error maps, to be learnt."""

    terms: tuple[str, ...]
    maps: tuple[LearntMap, ...] = ()

    @classmethod
    def parse(cls, choice: ModelChoice, joints: int = 6) -> Self:
        """From the option's words, for a robot of so many joints. Raises InputError."""
        words = [term.partition(":") for term in choice.split("+")]
        given = [name for name, _, _ in words]
        problem = _wrong(choice, given)
        if problem:
            cure = (
                f"auto, registration, or {', '.join(_TABLE[:-1])} or {_TABLE[-1]} with any of {', '.join(_effects())}: "
                "geometry+compliance"
            )
            raise InputError(Problem("--model", 0, 0, problem, cure))
        maps = [_map(name, settings, joints) for name, _, settings in words]
        terms = tuple(term for term in (*_ALONE, *_TABLE, *_effects()) if term in given)
        return cls(terms, tuple(made for made in maps if made is not None))

    @property
    def auto(self) -> bool:
        """Whether the data decide."""
        return self.terms == ("auto",)

    def groups(self) -> frozenset[str] | None:
        """`Task.groups` for these terms: None for all groups."""
        if self.auto or "geometry" in self.terms or POE in self.terms:
            return None
        free = {*self.terms} - {"registration", *(each.group for each in self.maps)}
        return frozenset({*free, "tool"} if free else free)

    def model(self, robot: RobotFile, at: Postures, *, touched: bool) -> RobotModel:
        """The nominal robot with the effects of these terms. auto: its tool bends, if it has a mass and touched.

        Raises InputError where the rows or the robot file cannot support a named one.
        """
        if self.auto:
            return nominal_model(robot, touched=touched)
        setup, known = inputs_of(robot, at), _effects()
        made: dict[str, Effect | None] = {each.group: each for each in self.maps}
        made = {term: made.get(term) or known[term].of_inputs(setup) for term in self.terms if term in known}
        lacking = [term for term, effect in made.items() if effect is None]
        if lacking:
            what = "cannot be seen in this data set"
            raise InputError(Problem("--model", 0, 0, f"{term} {what}", known[term].needs) for term in lacking)
        return nominal_model(robot).with_effects(tuple(effect for effect in made.values() if effect))

    def candidates(self, robot: RobotFile, at: Postures) -> tuple[Effect, ...] | None:
        """For auto the effects that these rows can support, in the order to be tried; None where the model is fixed."""
        if not self.auto:
            return None
        setup = inputs_of(robot, at)
        made = [kind.of_inputs(setup) for kind in kinds().values() if kind.chosen in ("tried", "by held-out rows")]
        return tuple(effect for effect in made if effect)


def inputs_of(robot: RobotFile, at: Postures) -> EffectInputs:
    """Inputs of the effects: the robot file's robot, and its rows' conditions."""
    return EffectInputs(robot.chain(), at, robot.tool.mass, robot.down())


def nominal_model(robot: RobotFile, *, touched: bool = False) -> RobotModel:
    """The robot as in its file; `touched`: with the effects of every touching tool, as far as the file supports
    them.
    """
    if not touched:
        return RobotModel(robot.chain())
    setup = inputs_of(robot, Postures(np.zeros((0, robot.n))))
    made = [kind.of_inputs(setup) for kind in kinds().values() if kind.of_touches]
    return RobotModel(setup.chain, tuple(effect for effect in made if effect))


def _effects() -> dict[str, type[Effect]]:
    """The effects that a user may name, by name."""
    return {group: kind for group, kind in kinds().items() if kind.chosen in ("named", "tried")}


def _wrong(choice: str, given: Collection[str]) -> str | None:
    unknown = [term for term in given if term not in (*_ALONE, *_TABLE, *_effects())]
    if unknown:
        return f"'{unknown[0]}' is not known"
    if len(set(given)) < len(given):
        return f"'{choice}' names a term twice"
    if len(given) > 1 and any(term in given for term in _ALONE):
        return f"'{choice}': {' and '.join(_ALONE)} stand alone"
    if sum(term in given for term in _TABLE) > 1:
        return f"'{choice}': name one of {', '.join(_TABLE)}: geometry holds the zeros"
    return None


def _map(name: str, settings: str, joints: int) -> LearntMap | None:
    """The error map with settings `key=value,…`; None for another term. Raises InputError."""
    kind = _effects().get(name)
    try:
        if kind is not None and issubclass(kind, LearntMap):
            return kind.of_options(settings, joints)
        if settings:
            raise ValueError("it has no settings")
    except (ValueError, ImportError) as error:
        raise InputError(
            Problem("--model", 0, 0, f"{name}: {error}", "docs/reference/error-maps.md lists the settings")
        ) from error
    return None
