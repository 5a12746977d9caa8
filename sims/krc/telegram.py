"""The telegram from robot to PC: `<Rob Type="KUKA">`, tags in the configuration's order, IPOC last."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import final

from sims.krc.ethernet_config import AXES, BadConfig, EthernetConfig

Value = Callable[[], Sequence[float]]

_POSE = ("X", "Y", "Z", "A", "B", "C")
_EXTERNAL = tuple(f"E{i}" for i in range(1, 7))
ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "RIst": _POSE,
    "RSol": _POSE,
    "AIPos": AXES,
    "ASPos": AXES,
    "EIPos": _EXTERNAL,
    "ESPos": _EXTERNAL,
    "MACur": AXES,
    "MECur": _EXTERNAL,
    "Delay": ("D",),
}
"""Tags that this controller can send, and their attributes: always six for axes, whatever the robot has."""


@final
class TelegramFormat:
    """Prints telegrams; `values` gives the numbers of each tag when one is sent. Raises BadConfig for other tags."""

    def __init__(self, config: EthernetConfig, precision: int, values: Mapping[str, Value]) -> None:
        unknown = [element.tag for element in config.send if element.tag not in ATTRIBUTES]
        if unknown:
            raise BadConfig(
                f"SEND: this controller has no {', '.join(unknown)}; it sends DEF_ and one of {', '.join(ATTRIBUTES)}"
            )
        elements = [_element_format(element.tag, element.type, precision) for element in config.send]
        self._template = f'<Rob Type="KUKA">{"".join(elements)}<IPOC>%d</IPOC></Rob>'
        self._values = [values[element.tag] for element in config.send]

    def print(self, ipoc: int) -> bytes:
        """The telegram of this moment."""
        numbers: list[float] = []
        for value in self._values:
            numbers.extend(value())
        return (self._template % (*numbers, ipoc)).encode()


def _element_format(tag: str, type_: str, precision: int) -> str:
    number = "%d" if type_ == "LONG" else f"%.{precision}f"
    return f"<{tag} " + " ".join(f'{name}="{number}"' for name in ATTRIBUTES[tag]) + "/>"
