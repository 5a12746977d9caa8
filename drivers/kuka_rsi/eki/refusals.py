"""The controller's codes and messages, turned into errors with a cure."""

from __future__ import annotations

from cellctl.devices import DeviceError, DeviceFault, DeviceRefused, LimitExceeded
from drivers.kuka_rsi.eki.documents import Reply

_LEAP_CURE = (
    "A set-point was too far from the one before. Does something else on this network answer the controller's "
    "telegrams? Compare RSI_ON in its program (absolute or relative) with mode in the address. Then reset at the "
    "pendant."
)
_CURES = {
    "KSS01102": _LEAP_CURE,
    "Command acceleration": _LEAP_CURE,
    "KSS29002": "Answers came late, not at all, or with another SENTYPE than the controller's Ethernet configuration "
    "names: compare SENTYPE, tags and port in the file named in the address with the one on the controller, look at "
    "the late and lost counts and at what else runs on this computer. Then reset at the pendant.",
    "KSS29000": "The overall correction limit on the controller (6 mm / 6 deg where no AXISCORRMON sets another) is "
    "lower than the search: shorten it, or raise MaxA1 … MaxA6. Then reset at the pendant.",
}
_RESET = "Look at the message at the pendant, remove its cause, acknowledge it and select the program again."


def cure_of(message: str) -> str:
    """The cure for a message of the controller."""
    return next((cure for number, cure in _CURES.items() if number in message), _RESET)


def refusal(device: str, reply: Reply, doing: str) -> DeviceError:
    """The error for a reply with a code other than 0 and 1; `doing`: the requested action."""
    text = f" ({reply.text})" if reply.text else ""
    match reply.code:
        case 10:
            return DeviceRefused(device, f"{doing}: the controller is busy with another command{text}")
        case 12:
            cure = "Acknowledge the message, switch the drives on, choose EXT and start the program."
            return DeviceRefused(device, f"{doing}: the controller is not ready{text}", cure)
        case 20:
            return LimitExceeded(device, f"{doing}: outside an axis limit{text}")
        case 21:
            return LimitExceeded(device, f"{doing}: speed outside 0.01 … 100 %{text}")
        case 30:
            return DeviceFault(device, f"{doing}: stopped by HALT; the robot is held{text}")
        case 31:
            return DeviceFault(device, f"{doing}: stopped by the controller: {reply.text}", cure_of(reply.text))
        case 40:
            cure = "A table holds for the one robot that it was identified on: push the one made for this controller."
            return DeviceRefused(device, f"{doing}: it was made for another controller{text}", cure)
        case 41:
            return DeviceRefused(device, f"{doing}: the check sum does not fit what arrived{text}", "Push again.")
        case 42:
            return DeviceRefused(device, f"{doing}: the controller has no such table or row{text}")
        case 43:
            return DeviceRefused(device, f"{doing}: the controller does not take that many rows{text}")
    return DeviceRefused(device, f"{doing}: not understood by the controller (code {reply.code}){text}")
