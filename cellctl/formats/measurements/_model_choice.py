"""The choice of the identified model: `auto`, or terms by name, `geometry+compliance`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Self, TypeAlias, final

import numpy as np

from cellctl.calibration import Effect, EffectInputs, Postures, RobotModel, kinds
from cellctl.files import InputError, Problem
from cellctl.robot_file import RobotFile

ModelChoice: TypeAlias = str
"""`auto`, `registration`, or terms joined by `+`: geometry (or zeros: joint zeros alone) and effects, in any order."""

_ALONE = ("auto", "registration")
_TABLE = ("geometry", "zeros")


@final
@dataclass(frozen=True, slots=True)
class ModelTerms:
    """A parsed model choice; the terms in the order of model names."""

    terms: tuple[str, ...]

    @classmethod
    def parse(cls, choice: ModelChoice) -> Self:
        """From the option's words. Raises InputError."""
        given = choice.split("+")
        problem = _wrong(choice, given)
        if problem:
            cure = (
                f"auto, registration, or {' or '.join(_TABLE)} with any of {', '.join(_effects())}: geometry+compliance"
            )
            raise InputError(Problem("--model", 0, 0, problem, cure))
        return cls(tuple(term for term in (*_ALONE, *_TABLE, *_effects()) if term in given))

    @property
    def auto(self) -> bool:
        """Whether the data decide."""
        return self.terms == ("auto",)

    def groups(self) -> frozenset[str] | None:
        """`Task.groups` for these terms: None for all groups."""
        if self.auto or "geometry" in self.terms:
            return None
        return frozenset() if self.terms == ("registration",) else frozenset({*self.terms, "tool"})

    def model(self, robot: RobotFile, at: Postures, *, touched: bool) -> RobotModel:
        """The nominal robot with the effects of these terms. auto: its tool bends, if it has a mass and touched.

        Raises InputError where the rows or the robot file cannot support a named one.
        """
        if self.auto:
            return nominal_model(robot, touched=touched)
        setup, known = inputs_of(robot, at), _effects()
        made = {term: known[term].of_inputs(setup) for term in self.terms if term in known}
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
    return f"'{choice}': geometry holds the zeros" if all(term in given for term in _TABLE) else None
