"""The commissioning of a cell's PLC: its safety inputs, by hand."""

from __future__ import annotations

from functools import partial

from cellctl.clock import Clock
from cellctl.devices import CellReadings, CommissioningStep, DeviceFault, Figure, Person

_WAIT_S = 60.0
"""Longest wait for an input, in the cell's time."""
_LOOK_S = 0.02

_INPUTS = {
    "guard_closed": ("Open the guard door", "open guard"),
    "emergency_stop_ok": ("Press an emergency stop", "press emergency stop"),
}
"""Input that ends → what to do, at the cell and at a simulated one."""

_BACK = "Release the emergency stop, close the guard door, acknowledge every message at the pendant"


def steps_of(plc: CellReadings, clock: Clock) -> tuple[CommissioningStep, ...]:
    """The step of `plc`, without motion."""
    return (
        CommissioningStep(
            "safety",
            "safety inputs by hand",
            "Somebody opens the guard door and presses an emergency stop; the inputs are read.",
            "a run ends when the safety chain opens",
            partial(_safety, plc, clock),
        ),
    )


async def _safety(plc: CellReadings, clock: Clock, person: Person) -> list[Figure]:
    figures = []
    for name, (text, action) in _INPUTS.items():
        await _until(plc, clock, name, expected=True)
        await person.told(text, plc.name, action)
        await _until(plc, clock, name, expected=False)
        await person.asked(_BACK, plc.name, "reset")
        await _until(plc, clock, name, expected=True)
        figures.append(Figure(name, f"{name} follows", "yes", wanted="yes"))
    return figures


async def _until(plc: CellReadings, clock: Clock, name: str, *, expected: bool) -> None:
    """Wait for a value of an input. Raises DeviceFault if it does not come."""
    try:
        async with clock.timeout(_WAIT_S):
            while (await plc.inputs())[name] is not expected:
                await clock.sleep(_LOOK_S)
    except TimeoutError:
        what = f"the input {name} has not become {int(expected)} within {_WAIT_S:g} s"
        raise DeviceFault(plc.name, what, "check its wire, and the I/O map in the PLC's program") from None
