"""Which model is identified: `auto`, or terms by name, `geometry+compliance`."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, TypeAlias, final

from cellctl.files import InputError, Problem
from cellctl.formats.measurements.conditions import approach_varies, payload_varies, warmth_varies
from cellctl.formats.robot import RobotFile

if TYPE_CHECKING:
    from cellctl.calibration import Effect, Postures, RobotModel

ModelChoice: TypeAlias = str
"""`auto`, `registration`, or terms joined by `+`: geometry (or zeros: joint zeros alone) and effects, in any order."""

EFFECT_TERMS = ("deflection", "compliance", "harmonics", "backlash", "growth")
_ALONE = ("auto", "registration")
_TABLE = ("geometry", "zeros")
_CURE = f"auto, registration, or {' or '.join(_TABLE)} with any of {', '.join(EFFECT_TERMS)}: geometry+compliance"


@final
@dataclass(frozen=True, slots=True)
class ModelTerms:
    """A model choice taken apart; the terms in the order that models are named in."""

    terms: tuple[str, ...]

    @classmethod
    def parse(cls, choice: ModelChoice) -> Self:
        """From the option's words. Raises InputError."""
        given = choice.split("+")
        problem = _wrong(choice, given)
        if problem:
            raise InputError(Problem("--model", 0, 0, problem, _CURE))
        return cls(tuple(term for term in (*_ALONE, *_TABLE, *EFFECT_TERMS) if term in given))

    @property
    def auto(self) -> bool:
        """Whether the data decide."""
        return self.terms == ("auto",)

    def groups(self) -> frozenset[str] | None:
        """What `Task.groups` is for these terms: None for all there is."""
        if self.auto or "geometry" in self.terms:
            return None
        return frozenset() if self.terms == ("registration",) else frozenset({*self.terms, "tool"})

    def model(self, robot: RobotFile, at: Postures, *, touched: bool) -> RobotModel:
        """The nominal robot with the effects of these terms. auto: its tool bends, if it has a mass and touched.

        Raises InputError where the rows or the robot file cannot support one that is named.
        """
        if self.auto:
            return nominal_model(robot, deflection=touched)
        effects: list[Effect] = []
        problems = []
        for term in self.terms:
            if term not in _SUPPORTED:
                continue
            made, cure = _SUPPORTED[term](robot, at), _CURES.get(term, "")
            effects += made
            if not made:
                problems.append(Problem("--model", 0, 0, f"{term} cannot be seen in this data set", cure))
        if problems:
            raise InputError(problems)
        return nominal_model(robot).with_effects(tuple(effects))

    def candidates(self, robot: RobotFile, at: Postures) -> tuple[Effect, ...] | None:
        """For auto the effects that these rows can support, in the order to be tried; None where the model is fixed."""
        if not self.auto:
            return None
        return tuple(made for term in EFFECT_TERMS[1:] for made in _SUPPORTED[term](robot, at))


def nominal_model(robot: RobotFile, *, deflection: bool = False) -> RobotModel:
    """The robot as its file says; with `deflection` its tool can bend, if it has a mass and stands out along z."""
    from cellctl.calibration import RobotModel

    return RobotModel(robot.chain(), _deflection(robot) if deflection else ())


def _wrong(choice: str, given: Collection[str]) -> str | None:
    unknown = [term for term in given if term not in (*_ALONE, *_TABLE, *EFFECT_TERMS)]
    if unknown:
        return f"'{unknown[0]}' is not known"
    if len(set(given)) < len(given):
        return f"'{choice}' names a term twice"
    if len(given) > 1 and any(term in given for term in _ALONE):
        return f"'{choice}': {' and '.join(_ALONE)} stand alone"
    return f"'{choice}': geometry holds the zeros" if all(term in given for term in _TABLE) else None


def _deflection(robot: RobotFile, _at: Postures | None = None) -> tuple[Effect, ...]:
    from cellctl.calibration import STANDARD_GRAVITY, ToolDeflection

    length_m, load_n = robot.tool.xyz[2] / 1000.0, robot.tool.mass * STANDARD_GRAVITY
    if length_m <= 0.0 or load_n <= 0.0:
        return ()
    return (ToolDeflection(length_m, load_n, down=robot.down()),)


def _compliance(robot: RobotFile, at: Postures) -> tuple[Effect, ...]:
    from cellctl.calibration import JointCompliance

    compliance = JointCompliance.of(robot.chain(), load_known=payload_varies(at), down=robot.down())
    return (compliance,) if compliance.parameters else ()


def _harmonics(robot: RobotFile, _at: Postures) -> tuple[Effect, ...]:
    from cellctl.calibration import Harmonics

    return (Harmonics(robot.n),)


def _backlash(robot: RobotFile, at: Postures) -> tuple[Effect, ...]:
    from cellctl.calibration import Backlash

    return (Backlash(robot.n),) if approach_varies(at) else ()


def _growth(robot: RobotFile, at: Postures) -> tuple[Effect, ...]:
    from cellctl.calibration import Growth

    return (Growth.of(robot.chain()),) if warmth_varies(at) else ()


_SUPPORTED: dict[str, Callable[[RobotFile, Postures], tuple[Effect, ...]]] = {
    "deflection": _deflection,
    "compliance": _compliance,
    "harmonics": _harmonics,
    "backlash": _backlash,
    "growth": _growth,
}
_CURES = {
    "deflection": "the robot file's tool needs a mass, and a length along z",
    "compliance": "every joint of this robot stands upright",
    "backlash": "columns D1…Dn, with 1 and -1 for at least one joint, say from which side each joint came",
    "growth": "a column temperature with different values",
}
