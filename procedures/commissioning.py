"""The last step of a commissioning: one touch of one sphere, as a campaign does it, slowly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from cellctl.clock import Clock
from cellctl.devices import (
    CellSteps,
    CommissioningStep,
    ContactProbe,
    Device,
    DeviceRefused,
    Figure,
    Person,
    SearchingRobot,
    SlowlyMoved,
)
from cellctl.files import Document
from cellctl.formats import artefact_of
from cellctl.procedure import CellFiles
from procedures.steps.contact_search import FoundContact, Speeds, search_and_retreat
from procedures.steps.sphere.planning import as_plan, plan_on
from procedures.steps.sphere.touch_plans import TouchPlan

_SPEEDS = Speeds(search_mm_s=1.0, transfer_percent=3.0)
"""3 % of the fastest axes of a robot of this class is 10 deg/s or less: below the 250 mm/s of T1."""

_PRESSED_MM = 0.5
"""Longest way of the tip after the contact at 1 mm/s: half a second."""

_SEED = 1


def _steps(
    cell: Document, robot_file: Path, devices: Mapping[str, Device], clock: Clock
) -> tuple[CommissioningStep, ...]:
    """One touch, of a cell with a robot that searches, a probe, spheres and postures."""
    robot, probe = devices.get("robot"), devices.get("probe")
    if not isinstance(robot, SearchingRobot) or not isinstance(probe, ContactProbe):
        return ()
    if not {"artefact", "postures"} <= cell.data.keys():
        return ()
    sphere = artefact_of(cell, ("artefact",)).spheres[0].id
    mode = robot.slow_mode if isinstance(robot, SlowlyMoved) else ""
    step = CommissioningStep(
        "touch",
        f"one touch of sphere {sphere}",
        f"{f'In {mode}, from' if mode else 'From'} its home posture: transfers at {_SPEEDS.transfer_percent:g} %, a "
        f"search on {sphere} at {_SPEEDS.search_mm_s:g} mm/s until contact, and back home.",
        "a campaign repeats this, faster" + (" and in EXT" if mode else ""),
        partial(_touch, CellFiles(cell, robot_file, _SEED), sphere, robot, probe, clock, mode),
        moves=True,
    )
    return (step,)


CELL_STEPS = CellSteps(_steps)


async def _touch(
    context: CellFiles, sphere: str, robot: SearchingRobot, probe: ContactProbe, clock: Clock, mode: str, person: Person
) -> list[Figure]:
    if mode and (await robot.health()).mode != mode:
        request = f"Select {mode} and hold the enabling switch, the robot at its home posture"
        await person.asked(request, robot.name, mode)
        if (found := (await robot.health()).mode) != mode:
            what = f"the controller is in {found}, not in {mode}"
            raise DeviceRefused(robot.name, what, f"{request}; then try again.")
    (planned,) = await clock.compute(plan_on, context, {sphere: 1}, _SEED)
    line = as_plan(0, planned, "fit")

    async def to_start() -> tuple[float, ...]:
        return await robot.move(tuple(line.start), _SPEEDS.near_percent)

    async def record(found: FoundContact) -> list[Figure]:
        return _figures(line, found)

    return await search_and_retreat(robot, probe, line, to_start, _SPEEDS, record)


def _figures(line: TouchPlan, found: FoundContact) -> list[Figure]:
    mm_per_deg = line.search_mm / math.dist(line.start, line.end)
    pressed_mm = mm_per_deg * math.dist(found.joints, found.found.resting)
    return [
        Figure("way_mm", "way to the contact", mm_per_deg * math.dist(found.start, found.joints), "mm"),
        Figure("pressed_mm", "way after the contact", pressed_mm, "mm", most=_PRESSED_MM),
        Figure("stop_cycles", "cycles from the contact to a constant set-point", found.found.stop_cycles),
        Figure("bounces", "further edges of the contact", found.contact.bounces),
        Figure("touch_sigma_us", "1 σ of the contact's time", found.contact.sigma_ns * 1e-3, "µs"),
    ]
