"""The telegram from robot to PC: `<Rob Type="KUKA">`, tags in the configuration's order, IPOC last."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import final

from sims.krc.ethernet_config import AXES, BadConfig, Element, EthernetConfig

Value = Callable[[], Sequence[float]]

_POSE = ("X", "Y", "Z", "A", "B", "C")
_EXTERNAL = tuple(f"E{i}" for i in range(1, 7))
_GENERATORS = tuple(f"{run}{generator}" for run in "CT" for generator in range(1, 7))
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
    **{f"Tech.{name}": tuple(f"{name}{i}" for i in range(1, 11)) for name in _GENERATORS},
}
"""Internal tags that this controller can send, and their attributes: always six for axes, whatever the robot has.

Tech: ten parameters of each function generator, `C` those of the main run, `T` those of the advance run.
"""


@final
class TelegramFormat:
    """Prints telegrams; `values` gives the numbers of each internal tag when one is sent, zeros where it has none.

    A tag with a channel shows zero, or an empty text: nothing is wired to that input of the ETHERNET object. Tags with
    one head (`Digout.o1`, `Digout.o2`) are attributes of one element. Raises BadConfig for other internal tags.
    """

    def __init__(self, config: EthernetConfig, precision: int, values: Mapping[str, Value]) -> None:
        unknown = [
            f"DEF_{element.tag}" for element in config.send if element.internal and element.tag not in ATTRIBUTES
        ]
        if unknown:
            known = ", ".join(tag for tag in ATTRIBUTES if not tag.startswith("Tech."))
            raise BadConfig(
                f"SEND: this controller has no {', '.join(unknown)}; after DEF_ it has {known}, "
                f"Tech.C1 … Tech.C6 and Tech.T1 … Tech.T6"
            )
        heads: dict[str, list[Element]] = {}
        for element in config.send:
            heads.setdefault(element.name, []).append(element)
        body = "".join(_element_format(head, elements, precision) for head, elements in heads.items())
        self._template = f'<Rob Type="KUKA">{body}<IPOC>%d</IPOC></Rob>'
        internal = [element.tag for elements in heads.values() for element in elements if element.internal]
        self._values = [values.get(tag) or _zeros(tag) for tag in internal]

    def print(self, ipoc: int) -> bytes:
        """The telegram of this moment."""
        numbers: list[float] = []
        for value in self._values:
            numbers.extend(value())
        return (self._template % (*numbers, ipoc)).encode()


def _zeros(tag: str) -> Value:
    zeros = (0.0,) * len(ATTRIBUTES[tag])
    return lambda: zeros


def _element_format(head: str, elements: Sequence[Element], precision: int) -> str:
    """An element of a template for `%`."""
    attributes, text = "", ""
    for element in elements:
        if element.internal:
            number = "%d" if element.type == "LONG" else f"%.{precision}f"
            attributes += "".join(f' {name}="{number}"' for name in ATTRIBUTES[element.tag])
        elif element.attribute:
            attributes += f' {element.attribute}="{_nothing(element.type, precision)}"'
        else:
            text = _nothing(element.type, precision)
    return f"<{head}{attributes}>{text}</{head}>" if text or not attributes else f"<{head}{attributes}/>"


def _nothing(type_: str, precision: int) -> str:
    """What a channel shows to which nothing is wired."""
    return {"STRING": "", "DOUBLE": f"{0:.{precision}f}"}.get(type_, "0")
