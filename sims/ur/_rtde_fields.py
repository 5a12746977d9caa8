"""The fields of RTDE: name, type and value of each output, name, type and effect of each input.

Names and types: the maker's RTDE guide, and data_package.cpp of Universal Robots' client library.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

from sims.ur._board import BITS, CONFIGURABLE, NUMBERS, STANDARD, TOOL, Board, Registers
from sims.ur._controller import Controller
from sims.ur._modes import RuntimeState, safety_status_bits
from sims.ur._poses import NO_TOOL
from sims.ur._robot_state import VOLTAGE

FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
"""Type → its bytes, as `struct` writes them, big-endian."""

Read: TypeAlias = Callable[[], Any]
Write: TypeAlias = Callable[[Any], object]
Outputs: TypeAlias = Mapping[str, tuple[str, Read]]
Inputs: TypeAlias = Mapping[str, tuple[str, Write]]

TOOL_OFF, TOOL_ON = 239, 253
GRAVITY_M_S2 = 9.82
PROGRAM_RUNS = (RuntimeState.PLAYING, RuntimeState.PAUSING)


def outputs_of(controller: Controller) -> Outputs:
    """Every output: its type, and its value now. Vectors are tuples."""
    motion, model, runtime = controller.motion, controller.model, controller.runtime

    def board() -> Board:
        return controller.board  # another one after each start of the controller

    def volts() -> float:
        return VOLTAGE if controller.powered else 0.0

    def status() -> int:
        return int(controller.powered) | int(runtime.state in PROGRAM_RUNS) << 1

    fields: dict[str, tuple[str, Read]] = {
        "timestamp": ("DOUBLE", controller.timestamp),
        "target_q": ("VECTOR6D", lambda: motion.target),
        "target_qd": ("VECTOR6D", lambda: motion.speed),
        "target_qdd": ("VECTOR6D", lambda: motion.acceleration),
        "target_current": ("VECTOR6D", partial(controller.currents, noise=False)),
        "target_moment": ("VECTOR6D", controller.moments),
        "actual_q": ("VECTOR6D", motion.actual),
        "actual_qd": ("VECTOR6D", motion.actual_speed),
        "actual_current": ("VECTOR6D", controller.currents),
        "joint_control_output": ("VECTOR6D", controller.currents),
        "actual_TCP_pose": ("VECTOR6D", lambda: model.tcp(motion.actual(), motion.tool)),
        "actual_TCP_speed": (
            "VECTOR6D",
            lambda: model.velocity(motion.actual(), motion.tool, motion.actual_speed()),
        ),
        "actual_TCP_force": ("VECTOR6D", lambda: NO_TOOL),
        "target_TCP_pose": ("VECTOR6D", lambda: model.tcp(motion.target, motion.tool)),
        "target_TCP_speed": ("VECTOR6D", lambda: model.velocity(motion.target, motion.tool, motion.speed)),
        "actual_digital_input_bits": ("UINT64", controller.digital_in),
        "joint_temperatures": ("VECTOR6D", lambda: (controller.scene.environment().arm_c,) * 6),
        "actual_execution_time": ("DOUBLE", lambda: 0.0),
        "robot_mode": ("INT32", lambda: int(controller.mode)),
        "joint_mode": ("VECTOR6INT32", lambda: (int(controller.joint_mode),) * 6),
        "safety_mode": ("INT32", lambda: int(controller.safety)),
        "safety_status": ("INT32", lambda: int(controller.safety)),
        "actual_tool_accelerometer": ("VECTOR3D", lambda: (0.0, 0.0, GRAVITY_M_S2)),
        "speed_scaling": ("DOUBLE", lambda: motion.scaling),
        "target_speed_fraction": ("DOUBLE", lambda: motion.slider),
        "actual_momentum": ("DOUBLE", lambda: 0.0),
        "actual_main_voltage": ("DOUBLE", lambda: VOLTAGE),
        "actual_robot_voltage": ("DOUBLE", volts),
        "actual_robot_current": ("DOUBLE", lambda: sum(map(abs, controller.currents(noise=False)))),
        "actual_joint_voltage": ("VECTOR6D", lambda: (volts(),) * 6),
        "actual_digital_output_bits": ("UINT64", lambda: board().digital_out),
        "runtime_state": ("UINT32", lambda: int(runtime.state)),
        "elbow_position": ("VECTOR3D", lambda: model.frames(motion.actual())[2][3]),
        "robot_status_bits": ("UINT32", status),
        "safety_status_bits": ("UINT32", lambda: safety_status_bits(controller.safety)),
        "analog_io_types": ("UINT32", lambda: sum(int(v) << i + 2 for i, v in enumerate(board().analog_out_voltage))),
        "standard_analog_input0": ("DOUBLE", lambda: 0.0),
        "standard_analog_input1": ("DOUBLE", lambda: 0.0),
        "standard_analog_output0": ("DOUBLE", lambda: board().analog_value(0)),
        "standard_analog_output1": ("DOUBLE", lambda: board().analog_value(1)),
        "io_current": ("DOUBLE", lambda: 0.0),
        "tool_mode": ("UINT32", lambda: TOOL_ON if controller.powered else TOOL_OFF),
        "tool_analog_input_types": ("UINT32", lambda: 0),
        "tool_analog_input0": ("DOUBLE", lambda: 0.0),
        "tool_analog_input1": ("DOUBLE", lambda: 0.0),
        "tool_output_voltage": ("INT32", lambda: board().tool_voltage),
        "tool_output_current": ("DOUBLE", lambda: 0.0),
        "tool_temperature": ("DOUBLE", lambda: controller.scene.environment().arm_c),
        "tcp_force_scalar": ("DOUBLE", lambda: 0.0),
        "ft_raw_wrench": ("VECTOR6D", lambda: NO_TOOL),
        "payload": ("DOUBLE", lambda: board().payload.mass),
        "payload_cog": ("VECTOR3D", lambda: board().payload.cog),
        "payload_inertia": ("VECTOR6D", lambda: board().payload.inertia),
        "script_control_line": ("UINT32", lambda: runtime.line),
        "tcp_offset": ("VECTOR6D", lambda: motion.tool_pose),
    }
    fields.update(_registers_read("output", lambda: board().outputs))
    fields.update(_registers_read("input", lambda: board().inputs))
    return fields


def _registers_read(direction: str, registers: Callable[[], Registers]) -> dict[str, tuple[str, Read]]:
    fields: dict[str, tuple[str, Read]] = {
        f"{direction}_bit_registers{first}_to_{first + 31}": ("UINT32", partial(_word, registers, first))
        for first in (0, 32)
    }
    fields.update({f"{direction}_bit_register_{i}": ("BOOL", partial(_bit, registers, i)) for i in range(BITS)})
    for i in range(NUMBERS):
        fields[f"{direction}_int_register_{i}"] = ("INT32", partial(_int, registers, i))
        fields[f"{direction}_double_register_{i}"] = ("DOUBLE", partial(_double, registers, i))
    return fields


def _bit(registers: Callable[[], Registers], i: int) -> bool:
    return registers().bits[i]


def _int(registers: Callable[[], Registers], i: int) -> int:
    return registers().ints[i]


def _double(registers: Callable[[], Registers], i: int) -> float:
    return registers().doubles[i]


def _word(registers: Callable[[], Registers], first: int) -> int:
    return registers().word(first)


def inputs_of(controller: Controller) -> Inputs:
    """Every input: its type, and what its value does. A mask or type is to be written before what it is of."""
    held: dict[str, int] = {}

    def hold(name: str) -> Write:
        return lambda value: held.__setitem__(name, value)

    def slider(value: float) -> None:
        if held.pop("speed", 0):
            controller.motion.slider = min(max(value, 0.0), 1.0)

    def digital(kind: str, place: tuple[int, int]) -> Write:
        return lambda value: controller.board.set_digital(held.pop(kind, 0), value, *place)

    def analog(which: int) -> Write:
        def write(value: float) -> None:
            if held.get("analog", 0) >> which & 1:
                controller.board.set_analog(which, value, voltage=bool(held.get("analog type", 0) >> which & 1))

        return write

    fields: dict[str, tuple[str, Write]] = {
        "speed_slider_mask": ("UINT32", hold("speed")),
        "speed_slider_fraction": ("DOUBLE", slider),
        "standard_digital_output_mask": ("UINT8", hold("standard")),
        "standard_digital_output": ("UINT8", digital("standard", STANDARD)),
        "configurable_digital_output_mask": ("UINT8", hold("configurable")),
        "configurable_digital_output": ("UINT8", digital("configurable", CONFIGURABLE)),
        "tool_digital_output_mask": ("UINT8", hold("tool")),
        "tool_digital_output": ("UINT8", digital("tool", TOOL)),
        "standard_analog_output_mask": ("UINT8", hold("analog")),
        "standard_analog_output_type": ("UINT8", hold("analog type")),
        "standard_analog_output_0": ("DOUBLE", analog(0)),
        "standard_analog_output_1": ("DOUBLE", analog(1)),
        "external_force_torque": ("VECTOR6D", lambda value: None),
    }

    def write(name: str, place: int) -> Write:
        return lambda value: getattr(controller.board.inputs, name).__setitem__(place, value)

    def word(first: int) -> Write:
        return lambda value: controller.board.inputs.set_word(first, value)

    for first in (0, 32):
        fields[f"input_bit_registers{first}_to_{first + 31}"] = ("UINT32", word(first))
    fields.update({f"input_bit_register_{i}": ("BOOL", write("bits", i)) for i in range(64, BITS)})
    for i in range(NUMBERS):
        fields[f"input_int_register_{i}"] = ("INT32", write("ints", i))
        fields[f"input_double_register_{i}"] = ("DOUBLE", write("doubles", i))
    return fields
