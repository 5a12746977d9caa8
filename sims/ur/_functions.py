"""All functions of the controller that a program can call, by their names."""

from __future__ import annotations

from collections.abc import Mapping

from sims.ur._controller import Controller
from sims.ur._functions_data import DataFunctions
from sims.ur._functions_io import IoFunctions, SocketFunctions
from sims.ur._functions_robot import RobotFunctions
from sims.ur._script_expressions import ScriptError, Value
from sims.ur._script_machine import Builtin

NOT_SIMULATED = (
    "direct_torque", "enable_external_ft_sensor", "end_force_mode", "end_freedrive_mode", "end_teach_mode",
    "force_mode", "freedrive_mode", "ft_rtde_input_enable", "get_coriolis_and_centrifugal_torques",
    "get_freedrive_status", "get_jacobian", "get_jacobian_time_derivative", "get_joint_torques", "get_mass_matrix",
    "get_target_waypoint", "interpreter_mode", "movec", "servoc", "set_gravity", "teach_mode", "tool_contact",
    "zero_ftsensor",
)  # fmt: skip
"""Functions that a controller has and this one does not: a program that names them runs, one that calls them ends."""
NO_FUNCTION = ("close_all",)


def builtins_of(controller: Controller) -> Mapping[str, Builtin]:
    """Name → function; one that takes time is a generator."""
    groups = [
        DataFunctions(controller.seed),
        RobotFunctions(controller),
        IoFunctions(controller),
        SocketFunctions(controller),
    ]
    found: dict[str, Builtin] = {name: _refusing(name) for name in NOT_SIMULATED}
    for group in groups:
        names = [name for name in dir(group) if not name.startswith("_") and name not in NO_FUNCTION]
        found.update({name: getattr(group, name) for name in names})
    return found


def _refusing(name: str) -> Builtin:
    def refuse(*values: Value, **named: Value) -> Value:
        raise ScriptError(f"{name} is not simulated")

    return refuse
