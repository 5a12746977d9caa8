"""`cellctl fleet`: which robots need a calibration, and why, by the parameters of all runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, write_json
from cellctl.operations.fleet import Fleet, FleetRobot
from cellctl.operations.fleet import fleet as fleet_of
from cellctl.operations.results import as_json
from cellctl.operations.run_indexing import current_index


def fleet(
    type_: Annotated[str, typer.Option("--type", help="Show only robots of this type.")] = "",
    site: Annotated[str, typer.Option(help="Show only robots of this site, as their cell files state it.")] = "",
    every: Annotated[bool, typer.Option("--all", help="List the robots without a reason too.")] = False,
    folder: arguments.Runs = Path("runs"),
    index: arguments.Index = None,
    json_: arguments.Json = None,
) -> None:
    """Show which robots need a calibration, and why.

    Reasons: failed checks, parameters whose charts are outside their limits, age of the calibration.

    Example: cellctl fleet --site "hall 3"
    """
    refuse_outputs({"--json": json_}, list(folder.glob("*/*")) if json_ not in (None, "-") else [])
    with current_index(folder) as found:
        told = fleet_of(found, folder, robot_type=type_, site=site)
    write_json(as_json(told), json_)
    if json_ != "-":
        for line in _lines(told, folder, every=every):
            typer.echo(line)


def _lines(told: Fleet, folder: Path, *, every: bool) -> Iterator[str]:
    if not told.robots:
        yield f"No run in {folder} is of such a robot."
        return
    yield f"{len(told.to_calibrate)} of {len(told.robots)} robots need a calibration"
    for robot in told.robots if every else told.to_calibrate:
        yield from _robot_lines(robot)
    for group in told.groups:
        yield f"{group.kind} {group.name}: {group.to_calibrate} of {group.robots} robots to calibrate"
        for each in group.moved:
            yield f"    most robots together: {each.words}; look at instrument and temperature first"
    for small in told.small_sigmas:
        whose = f"of {small.serial}" if small.serial else f"of all robots {small.type}".rstrip()
        yield f"σ of {small.name} {whose} is too small: the scatter between runs is {small.scale:g} times it"
    if told.left_out:
        yield f"{told.left_out} runs are not compared: of another nominal robot, or with the model of an earlier run"


def _robot_lines(robot: FleetRobot) -> Iterator[str]:
    where = ", ".join(text for text in (robot.type, robot.site, "SIMULATED" * robot.simulated) if text)
    yield f"{robot.serial} ({where}): {robot.state}"
    if robot.reasons:
        yield f"    {robot.words}"
    if robot.calibrated:
        checks = f"{robot.runs} runs with it, {robot.runs_a_year:g} a year, {robot.charts} charts"
        yield f"    calibrated {robot.calibrated[:10]} by {robot.calibration}; {checks}"
