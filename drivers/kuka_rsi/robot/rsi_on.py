"""Compares what the controller's program passes to RSI_ON with the robot's address."""

from __future__ import annotations

from collections.abc import Mapping

from cellctl.devices import DeviceRefused
from drivers.kuka_rsi.cyclic.cycle_timing import InterpolationCycle
from drivers.kuka_rsi.settings import RsiSettings

REMEDY = (
    "Write into the robot's address what the controller's program passes to RSI_ON; or write the controller's files "
    "again (`cellctl krl`) and load all of them."
)


def in_words(cycle: InterpolationCycle) -> str:
    """`cycle=ipo (12 ms)`."""
    return f"cycle={cycle} ({cycle.milliseconds} ms)"


def refusal_of_program(device: str, ident: Mapping[str, str], settings: RsiSettings) -> DeviceRefused | None:
    """The error if `ident`, of HELLO, names another mode or cycle than the address; None if it names none.

    A program of older files names none: its first telegrams show the cycle, and the joints the mode.
    """
    wanted = {"Correction": settings.mode.upper(), "Cycle": settings.cycle.upper()}
    named = {key: ident[key] for key in wanted if key in ident}
    if named.items() <= wanted.items():
        return None
    rsi_on = ",".join(f"#{value}" for value in named.values())
    what = f"the controller's program has RSI_ON({rsi_on}), and the address mode={settings.mode}"
    return DeviceRefused(device, f"{what} and {in_words(settings.cycle)}", REMEDY)
