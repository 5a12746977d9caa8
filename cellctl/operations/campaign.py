"""Loads a campaign from its files: procedure, parameters, cell; reports every error in them at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

from cellctl.clock import WallClock
from cellctl.devices import Conditions
from cellctl.devices.cell import Cell
from cellctl.devices.commissioning_record import commissioning_warnings
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile, artefact_of
from cellctl.operations.cell_devices import require_cells, simulation_errors
from cellctl.procedure import (
    CellFiles,
    DeviceConditions,
    Procedure,
    StepRegistry,
    check_cell,
    checked_parameters,
    expected_passes,
    load_procedure,
)


@final
@dataclass(frozen=True)
class Campaign:
    """A procedure and a cell that passed all checks that need no open device."""

    procedure: Procedure
    parameters: dict[str, Any]
    cell: Cell
    registry: StepRegistry
    drivers: DriverRegistry

    @property
    def expected_passes(self) -> int:
        """Total number of passes of the loops, as far as known before the run."""
        return expected_passes(self.procedure, self.parameters, self.registry)


def load_campaign(
    procedure_file: Path,
    cell_file: Path | None,
    settings: list[str],
    *,
    seed: int | None = None,
    resumed: bool = False,
    runs: Path = Path("runs"),
) -> Campaign:
    """Load and check a procedure and its cell (or another one), robot file and artefact included. Opens no device.

    seed: the run's, None: the cell file's. resumed: the steps checked the cell when the run began, and do not
    check it again. runs: folder of the runs that parameters name. Raises InputError with all errors in the files
    and in the settings.
    """
    require_cells()
    drivers, registry = DriverRegistry(), StepRegistry.installed()
    problems: list[Problem] = []
    procedure = load_procedure(procedure_file)
    cell = _cell(procedure, cell_file, drivers, problems)
    kinds = {name: drivers.abilities(address.scheme) for name, address in cell.addresses.items()} if cell else None
    parameters: dict[str, Any] = {}
    try:
        parameters = checked_parameters(procedure, settings, registry, kinds, _conditions(procedure, cell, drivers))
    except InputError as error:
        problems += error.problems
    if not problems and cell and not resumed:
        context = CellFiles(cell.document, cell.robot_file, cell.seed if seed is None else seed, runs)
        problems += check_cell(procedure, parameters, registry, context)
    if problems or cell is None:
        raise InputError(problems)
    return Campaign(procedure, parameters, cell, registry, drivers)


def _conditions(procedure: Procedure, cell: Cell | None, drivers: DriverRegistry) -> DeviceConditions:
    """The conditions of the devices that interlocks name; drivers provide them before connecting."""
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
        problems += simulation_errors(cell.document, path)
    problems += _robot_and_artefact(cell)
    return replace(cell, warnings=(*cell.warnings, *commissioning_warnings(cell, drivers)))


def _robot(file: Path) -> None:
    RobotFile.load(file).refuse_prismatic(str(file), "a campaign")


def _robot_and_artefact(cell: Cell) -> list[Problem]:
    """Errors in the robot file that the cell names, and in its artefact, if any."""
    problems: list[Problem] = []
    artefact = (lambda: artefact_of(cell.document, ("artefact",)),) if "artefact" in cell.document.data else ()
    for load in (lambda: _robot(cell.robot_file), *artefact):
        try:
            load()
        except InputError as error:
            problems += error.problems
    return problems
