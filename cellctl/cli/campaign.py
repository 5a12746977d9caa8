"""A campaign put together from its files: procedure, parameters, cell; every mistake in them at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from cellctl.cli.simulated import simulation_mistakes
from cellctl.clock import WallClock
from cellctl.devices import Conditions
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem
from cellctl.procedure import DeviceConditions, Procedure, StepRegistry, checked_parameters, load_procedure


@final
@dataclass(frozen=True)
class Campaign:
    """A procedure and a cell without a mistake that can be found without opening a device."""

    procedure: Procedure
    parameters: dict[str, Any]
    cell: Cell
    registry: StepRegistry
    drivers: DriverRegistry


def load_campaign(procedure_file: Path, cell_file: Path | None, settings: list[str]) -> Campaign:
    """Load and check a procedure and its cell (or another one). Opens no device.

    Raises InputError with all mistakes in both files and in the settings.
    """
    drivers, registry = DriverRegistry(), StepRegistry.installed()
    problems: list[Problem] = []
    procedure = load_procedure(procedure_file)
    cell = _cell(procedure, cell_file, drivers, problems)
    kinds = {name: drivers.kind(address.scheme) for name, address in cell.addresses.items()} if cell else None
    parameters: dict[str, Any] = {}
    try:
        parameters = checked_parameters(procedure, settings, registry, kinds, _conditions(procedure, cell, drivers))
    except InputError as error:
        problems += error.problems
    if problems or cell is None:
        raise InputError(problems)
    return Campaign(procedure, parameters, cell, registry, drivers)


def _conditions(procedure: Procedure, cell: Cell | None, drivers: DriverRegistry) -> DeviceConditions:
    """The conditions of the devices that interlocks name; a driver's device knows them before it is connected."""
    found = {}
    for name in {interlock.device for interlock in procedure.interlocks} & (cell.addresses.keys() if cell else set()):
        assert cell is not None
        device = drivers.open(name, cell.addresses[name], cell.surroundings(name, WallClock()))
        found[name] = device.conditions() if isinstance(device, Conditions) else {}
    return found


def _cell(
    procedure: Procedure, cell_file: Path | None, drivers: DriverRegistry, problems: list[Problem]
) -> Cell | None:
    path = cell_file or procedure.cell
    if path is None:
        problems.append(procedure.document.problem((), "names no cell", "add `cell:`, or give --cell"))
        return None
    try:
        cell = Cell.load(path, drivers)
    except InputError as error:
        problems += error.problems
        return None
    if cell.simulated:
        problems += simulation_mistakes(cell.document, path)
    return cell
