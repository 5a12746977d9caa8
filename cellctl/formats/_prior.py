"""A prior model that new rows update, completely or only in named groups."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from cellctl.calibration import RobotModel
from cellctl.files import InputError, Problem
from cellctl.formats.measurements import Measurements
from cellctl.formats.model import ModelFile
from cellctl.kinematics import Floats
from cellctl.robot_file import RobotFile

GROUPS = ("zeros", "links", "geometry", "tool", "base", "points", "datums")
"""Groups that every model has; its effects are groups of their own."""

LEANING = 0.002
"""A change of the direction of weight below this, rad, has no measurable effect."""


def from_prior(measured: Measurements, prior: ModelFile, free: Collection[str] = (), file: str = "") -> Measurements:
    """The same rows for `prior` in place of nominal. free: the only groups that may change, with a flat prior; none
    named: everything, within the prior model's uncertainty. file: names the model in errors.

    Of a model with several sessions, the session that the rows name first is updated. Raises InputError where it is
    another robot's model, or has no such group, or where base or tool would have to be those of a session and none is
    named.
    """
    problems = _another_robot(prior.robot, measured.robot, file)
    model, groups = prior.robot_model(), frozenset(free) or None
    problems += _stands_otherwise(model, measured.robot, file)
    problems += _unknown_groups(model, free)
    if problems:
        raise InputError(problems)
    model, covariance = _in_session(prior, measured, groups, file)
    if groups and "tool" in groups and measured.robot.tool != prior.robot.tool:
        model = model.on(model.chain.base_now, measured.robot.chain().tool)
    task = replace(
        measured.task,
        model=model,
        prior=covariance,
        groups=groups,
        candidates=None,
        nominal=measured.task.model,
        region=prior.measured_region(),
    )
    return replace(measured, task=task)


def only(measured: Measurements, free: Collection[str]) -> Measurements:
    """The same rows, with these groups alone free about nominal. Raises InputError for an unknown group."""
    problems = _unknown_groups(measured.task.model, free)
    if problems:
        raise InputError(problems)
    return replace(measured, task=replace(measured.task, groups=frozenset(free), candidates=None))


def _in_session(
    prior: ModelFile, measured: Measurements, groups: frozenset[str] | None, file: str
) -> tuple[RobotModel, Floats]:
    """The prior model in the session that the rows name first, and its covariance (P, P)."""
    model, covariance = prior.robot_model(), np.array(prior.covariance)
    name = next(iter(measured.texts("session")), "")
    number = next((at for at, session in enumerate(prior.sessions) if session.name == name), None)
    if number is None and _of_a_session(prior, measured, groups):
        names = ", ".join(session.name for session in prior.sessions)
        what = f"has a base or tool for each of its sessions ({names}), and the rows name none of them"
        cure = "say in column `session` in which the rows were measured, or free what is new: --free base, tool"
        raise InputError(Problem(file or "--prior", 0, 0, what, cure))
    if not number:
        return model, covariance
    session = prior.sessions[number]
    if session.covariance is None or np.shape(session.covariance) != covariance.shape:
        what = f"does not say how sure it is of session {name}"
        raise InputError(Problem(file or "--prior", 0, 0, what, "make the model anew from its data set"))
    return model.on(session.base, session.tool), np.array(session.covariance)


def _of_a_session(prior: ModelFile, measured: Measurements, groups: frozenset[str] | None) -> bool:
    """Whether base or tool of one of several sessions would be reused: not where they are found anew."""
    instrument = any(block.of_instrument for block in measured.task.rows.blocks)
    own = {group for session in prior.sessions[1:] for group in session.own}
    if groups is None:  # an update finds both anew where an instrument measured
        return bool(own - {"base"}) and not instrument
    return bool((own if instrument else own - {"base"}) - groups)


def _another_robot(older: RobotFile, robot: RobotFile, file: str) -> list[Problem]:
    """Differences that show two different robots; tool, base and limits may differ."""
    differ = differing_parts(older, robot)
    if not differ:
        return []
    what = f"is a model of '{older.name}' with another {' and '.join(differ)} than '{robot.name}' has"
    return [Problem(file or "--prior", 0, 0, what, "give the robot file that the model was made with")]


def differing_parts(older: RobotFile, robot: RobotFile) -> list[str]:
    """Names of the parts in which the nominal arms of two robot files differ."""
    pairs = [
        ("convention", older.convention, robot.convention),
        ("link table", (older.links, older.screws, older.home), (robot.links, robot.screws, robot.home)),
        ("joint signs and offsets", _joints(older), _joints(robot)),
    ]
    return [name for name, theirs, ours in pairs if theirs != ours]


def _stands_otherwise(model: RobotModel, robot: RobotFile, file: str) -> list[Problem]:
    """An error where the direction of weight has changed since the model: joints without load then may carry some
    now.
    """
    now, before = robot.down(), [getattr(effect, "down", robot.down()) for effect in model.effects]
    if all(math.dist(down, now) < LEANING for down in before):
        return []
    what = f"is a model of a robot that stood otherwise than '{robot.name}' does (mounting, base)"
    return [Problem(file or "--prior", 0, 0, what, "fit this robot as it is now, without --prior")]


def _joints(robot: RobotFile) -> list[tuple[int, float]]:
    return [(joint.sign, joint.offset) for joint in robot.joints]


def _unknown_groups(model: RobotModel, free: Collection[str]) -> list[Problem]:
    known = (*GROUPS, *dict.fromkeys(effect.group for effect in model.effects))
    unknown = [group for group in free if group not in known]
    return [Problem("--free", 0, 0, f"no group '{group}' in this model", ", ".join(known)) for group in unknown]
