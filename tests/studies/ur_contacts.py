"""What a contact costs that is taken when the controller's input shows it, against one at the probe's time (5 minutes).

The same touch again and again on the simulated UR10e, at several search speeds and with both controllers' cycles. The
tip along the search at the probe's stated time, and at the first sample whose input is closed. Prints a Markdown table.
A study and no test: it judges nothing.
"""

from __future__ import annotations

import asyncio
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import load_yaml
from cellctl.formats import RobotFile
from cellctl.operations.cell_devices import SimulatedCell
from procedures.steps.contact_search import FoundContact, Speeds, search_and_retreat
from procedures.steps.sphere.planning import as_plan, plan_on
from procedures.steps.sphere.touch_plans import TouchPlan
from tests.helpers.runs import ROOT
from tests.helpers.steps import Context
from tests.studies._runner import Row, Study, Table, each

CELL = ROOT / "procedures" / "cells" / "ur10e_cell.yaml"
ROBOT = ROOT / "procedures" / "robots" / "ur10e_probe.yaml"
CYCLES_S = {"e": 0.002, "cb3": 0.008}
SPEEDS_MM_S = (2.5, 5.0, 10.0)
TOUCHES = 30
HEAD = (
    "| cycle | search speed | scatter by the probe's time | scatter by the input | input later by, mean | "
    "its scatter | vT/√12 |\n|---|---|---|---|---|---|---|"
)


def measure(series: str, speed: float) -> Row:
    """stated, sampled: the tip's way, mm, from the start of each search to the contact, one each touch."""
    with tempfile.TemporaryDirectory() as place:
        text = CELL.read_text().replace("../robots/", f"{ROOT}/procedures/robots/")
        text = text.replace("programs: ur10e_programs", f"series: {series}, programs: {CELL.parent}/ur10e_programs")
        file = Path(place) / "cell.yaml"
        file.write_text(text)
        return asyncio.run(_touches(file, speed))


async def _touches(file: Path, speed: float) -> Row:
    context: Any = Context(robot_file=ROBOT, cell=load_yaml(file))
    context.seed = 1
    line = as_plan(0, plan_on(context, {"S2": 1}, 1)[0], "fit")
    drivers, random = DriverRegistry(), np.random.default_rng(1)
    cell = Cell.load(file, drivers)
    simulated = await SimulatedCell.start(cell, None, None)
    try:
        clock = await simulated.clock()
        around = {name: cell.surroundings(name, clock, simulated.state) for name in ("robot", "probe")}
        robot, probe = (drivers.open(name, simulated.address(name), each) for name, each in around.items())
        try:
            await robot.connect()
            await probe.connect()
            await robot.move(tuple(line.origin), 40.0)
            rows = [await _touch(robot, probe, line, speed, random.uniform()) for _ in range(TOUCHES)]
        finally:
            await robot.close()
            await probe.close()
            await clock.aclose()
    finally:
        simulated.stop()
    return {"stated": [row[0] for row in rows], "sampled": [row[1] for row in rows]}


async def _touch(robot: Any, probe: Any, line: TouchPlan, speed: float, aside: float) -> tuple[float, float]:
    """Both ways, mm. aside: the search begins up to 0.3 mm later, so that the input is sampled at any moment."""
    begin, end = np.array(line.start), np.array(line.end)
    start = tuple((begin + aside / 60.0 * (end - begin)).tolist())
    inputs: list[Any] = []
    result_of = robot._result

    def kept(samples: list[Any], *others: Any) -> Any:
        inputs[:] = samples
        return result_of(samples, *others)

    robot._result = kept

    async def record(found: FoundContact) -> FoundContact:
        return found

    found = await search_and_retreat(robot, probe, line, lambda: robot.move(start, 20.0), Speeds(speed, 40.0), record)
    robot._result = result_of
    await robot.move(tuple(line.origin), 40.0)
    chain, joints = RobotFile.load(ROBOT).chain(), RobotFile.load(ROBOT).joint_map()
    seen = next(sample.joints for sample in inputs if robot._wired(sample))
    places = chain.forward(joints.model([line.start, line.end, found.joints, seen]))[:, :3, 3]
    along = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
    return float((places[2] - places[0]) @ along), float((places[3] - places[0]) @ along)


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """A line for each cycle and speed."""
    yield Table("\n".join([HEAD, *map(line_of, found)]), "contacts by the input")


def line_of(row: Row) -> str:
    """Of the table, µm."""
    stated, sampled = 1000.0 * np.array(row["stated"]), 1000.0 * np.array(row["sampled"])
    later, cycle = sampled - stated, CYCLES_S[row["series"]]
    figures = (stated.std(ddof=1), sampled.std(ddof=1), later.mean(), later.std(ddof=1))
    expected = 1000.0 * row["speed"] * cycle / 12.0**0.5
    cells = " | ".join(f"{value:.1f} µm" for value in (*figures, expected))
    return f"| {1000.0 * cycle:.0f} ms | {row['speed']:g} mm/s | {cells} |"


STUDY = Study(lambda _: each(series=CYCLES_S, speed=SPEEDS_MM_S), measure, tables, writes=True)
