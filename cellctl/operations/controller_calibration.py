"""The maker's calibration of an arm, asked from its controller."""

from __future__ import annotations

from pathlib import Path

from cellctl.devices import CalibratedArm
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem, load_yaml
from cellctl.formats.makers_calibration import calibration_of_rows
from cellctl.kinematics import Link
from cellctl.operations.cell_devices import connected, require_cells
from cellctl.operations.exporting import Source, calibrated_source
from cellctl.robot_file import RobotFile

ROBOT = "robot"
"""What every step calls the cell's robot."""


def is_cell(path: Path) -> bool:
    """Whether `path` is a cell file. Raises InputError where a YAML file cannot be read."""
    if path.suffix.lower() not in (".yaml", ".yml"):
        return False
    data = load_yaml(path).data
    return isinstance(data, dict) and "devices" in data


async def controller_source(path: Path, sheet: Path | None) -> Source:
    """The robot of the cell file `path` as its controller computes it; nothing moves. sheet: its data sheet's robot
    file, None: the cell's.

    Raises InputError where the cell's robot states no calibration, or is another than `sheet`, and DeviceError.
    """
    require_cells()
    drivers = DriverRegistry()
    cell = Cell.load(path, drivers)
    if ROBOT not in cell.addresses:
        raise InputError(Problem(str(path), 0, 0, f"has no device '{ROBOT}'", "name the arm so"))
    async with connected(cell, drivers, [ROBOT]) as devices:
        device, identity = devices[ROBOT].device, devices[ROBOT].identity
        if not isinstance(device, CalibratedArm):
            what = "its controller states no calibration of the arm"
            raise InputError(Problem(str(path), 0, 0, what, "read it from a file: docs/reference/importing.md"))
        rows = await device.arm_rows()
    links = [
        Link(theta, d, a, alpha) for theta, d, a, alpha in zip(rows.theta, rows.d, rows.a, rows.alpha, strict=True)
    ]
    nominal = RobotFile.load(sheet or cell.robot_file)
    controller = f"controller {identity.serial}"
    return calibrated_source(controller, calibration_of_rows(links, controller, nominal), nominal)
