"""A cell file's `postures:`: joint readings of its robot from which a campaign starts."""

from __future__ import annotations

from typing import Annotated, Literal, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.files import Document, InputError, Problem
from cellctl.files.validated import validated
from cellctl.formats.robot import RobotFile

Reading = Annotated[float, Field(allow_inf_nan=False)]


@final
class Postures(BaseModel):
    """Joint readings A1…An, degrees.

    `home`: where campaigns begin and end; `touch`: from which the inverse kinematics of touches starts; `turn`: from
    which single axes are turned, also the return pose of campaigns with an instrument.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    home: list[Reading]
    touch: list[list[Reading]] = []
    turn: list[Reading] | None = None


def postures_of(document: Document, robot: RobotFile, need: Literal["touch", "turn"]) -> Postures:
    """The postures of a loaded cell file, checked against `robot`; `need`: those that may not be missing.

    Raises InputError with every error.
    """
    postures = validated(document, Postures, ("postures",))
    if not getattr(postures, need):
        what = f"there are no postures '{need}'"
        place = ("postures", need) if need in document.data["postures"] else ("postures",)
        raise InputError(document.problem(place, what, f"give `{need}:` with joint readings, degrees", key=True))
    problems = _problems(document, ("home",), postures.home, robot)
    if postures.turn is not None:
        problems += _problems(document, ("turn",), postures.turn, robot)
    for index, posture in enumerate(postures.touch):
        problems += _problems(document, ("touch", index), posture, robot)
    if problems:
        raise InputError(problems)
    return postures


def _problems(document: Document, at: tuple[str | int, ...], readings: list[float], robot: RobotFile) -> list[Problem]:
    place = ("postures", *at)
    if len(readings) != len(robot.joints):
        what = f"{len(readings)} joint readings for a robot with {len(robot.joints)} joints"
        return [document.problem(place, what, "write A1 to the last joint, degrees")]
    return [
        document.problem(place, f"A{number} {reading:g} is outside {joint.min:g}…{joint.max:g}°")
        for number, (reading, joint) in enumerate(zip(readings, robot.joints, strict=True), 1)
        if not joint.min <= reading <= joint.max
    ]
