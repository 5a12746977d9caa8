"""What a controller's RSI_ON is, compared with the robot's address and with the session that is answered."""

from __future__ import annotations

from collections.abc import Mapping

from cellctl.devices import DeviceLost, DeviceRefused
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


def restarted(device: str, what_now: str) -> DeviceLost:
    """RSI was switched off and on within the tolerance, or telegrams were lost and no Delay refutes it."""
    return DeviceLost(
        device,
        "the controller's telegrams are not those of one RSI session (its count went on; its Delay, mark or programmed "
        f"joints are those of a new one): {what_now}",
        "Look at the pendant whether RSI was switched off and on, or the program reset. Where telegrams are only lost, "
        "look at the network; with DEF_Delay, or files written by `cellctl krl`, lost telegrams alone end no session.",
    )
