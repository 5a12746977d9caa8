"""RSI telegrams: `<Rob>` read by name, `<Sen>` written in the configuration's order, absolute or relative."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import StrEnum
from typing import final
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from drivers.kuka_rsi import AXES, AXIS_NAMES
from drivers.kuka_rsi.cyclic.limits import Correction

DECIMALS = 6
"""Decimals of the corrections in a reply, deg: 1e-6 deg is 0.07 µm at 3.9 m.

The context's Precision rounds only what the robot sends; what it receives is read in full.
"""

LARGEST_IPOC = 10**15
LARGEST_DELAY = 10**9
FARTHEST_JOINT_DEG = 3600.0
LARGEST_CURRENT = 1e6
LARGEST_MARK = 1e6
"""Ranges of the values in a telegram; others show that it is not from a controller. They are no limits of a robot: ten
turns of an axis, 30 000 years of milliseconds.

IPOC, and a rise of it, go into slots of eight bytes (`shared_block`): a number that does not fit there would end the
process by an exception.
"""

MARK = "C21", "C22"
"""Parameters of function generator 2 (DEF_Tech.C2) with the session's mark and its negative; else it is no mark."""

COARSEST_DEG = 0.1
"""Step of the joints at `Precision` 1, the coarsest that RSI has by default."""

_WRITTEN = r"[-+]?[0-9]{1,20}(?:\.([0-9]{0,30}))?(?:[eE][-+]?[0-9]{1,3})?"
_NUMBER = re.compile(_WRITTEN)
_NUMBERS = re.compile(" ".join([_WRITTEN] * AXES))
"""The six numbers of an element with a space between: one match for all of them, in each cycle."""


@final
@dataclass(frozen=True, slots=True)
class Telegram:
    """The controller's data of one cycle.

    `ipoc_text`: its count as written, to be echoed unchanged; `ipoc`: the count, 0 … 10^15; `joints`: A1…A6 actual
    (AIPos), degrees, ±3600; `delay`: its own count of late answers, 0 … 10^9, if it sends one; `resolution_deg`:
    last decimal of the joints; `currents`: motor currents (MACur), None if it sends none or not six numbers;
    `programmed`: A1…A6 of the program (ASPos), which a correction does not move, degrees; None as with currents;
    `mark`: number that the controller's program gives its RSI session (`MARK`), 0 if it gives none.
    """

    ipoc_text: str
    ipoc: int
    joints: tuple[float, ...]
    delay: int | None
    resolution_deg: float = COARSEST_DEG
    currents: tuple[float, ...] | None = None
    programmed: tuple[float, ...] | None = None
    mark: int = 0


def read_telegram(datagram: bytes) -> Telegram:
    """Read a `<Rob>` telegram by the names in it; order, attributes of the root and unknown tags do not matter.

    Raises ValueError if it is not a telegram, lacks IPOC or AIPos, or has a number out of range.
    """
    if b"<!" in datagram:  # a controller sends none; entities of a DOCTYPE may take longer to expand than the cycle
        raise ValueError("a telegram has no DOCTYPE, comment or CDATA")
    try:
        root = ElementTree.fromstring(datagram)
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"not XML: {error}") from None
    if root.tag != "Rob":
        raise ValueError(f"<{root.tag}> instead of <Rob>")
    joints, ipoc, delay = root.find("AIPos"), root.findtext("IPOC"), root.find("Delay")
    if joints is None or ipoc is None:
        raise ValueError("without AIPos or IPOC")
    joints_deg, decimals = _axes(joints, FARTHEST_JOINT_DEG)
    late = None if delay is None else round(_number(delay.get("D", ""), 0, LARGEST_DELAY))
    resolution = min(COARSEST_DEG, 10.0**-decimals)
    currents = _optional(root.find("MACur"), LARGEST_CURRENT)
    programmed = _optional(root.find("ASPos"), FARTHEST_JOINT_DEG)
    return Telegram(ipoc, _count(ipoc), joints_deg, late, resolution, currents, programmed, _mark(root.find("Tech")))


def _mark(element: ElementTree.Element | None) -> int:
    """Two numbers of opposite sign: a program that uses the generator for something else is not taken for one."""
    if element is None:
        return 0
    try:
        mark, negative = (_number(element.get(name, ""), -LARGEST_MARK, LARGEST_MARK) for name in MARK)
    except ValueError:
        return 0
    return round(mark) if mark == -negative > 0 else 0


def _optional(element: ElementTree.Element | None, largest: float) -> tuple[float, ...] | None:
    """A search does not depend on them: a telegram is valid without."""
    if element is None:
        return None
    try:
        return _axes(element, largest)[0]
    except ValueError:
        return None


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 20 and int(text) <= LARGEST_IPOC):
        raise ValueError(f"IPOC '{text[:40]}' is no count within 0 … {LARGEST_IPOC}")
    return int(text)


def _axes(element: ElementTree.Element, largest: float) -> tuple[tuple[float, ...], int]:
    """The numbers A1…A6 in ASCII digits, each within ±`largest`, and the most decimals among them."""
    texts = [element.get(name, "") for name in AXIS_NAMES]
    written = _NUMBERS.fullmatch(" ".join(texts))
    if written is None:
        raise ValueError(f"A1…A6 of {element.tag} are not six numbers: {', '.join(text[:40] for text in texts)}")
    values = tuple(map(float, texts))
    if not max(map(abs, values)) <= largest:
        raise ValueError(f"A1…A6 of {element.tag} are not within ±{largest:g}: {', '.join(texts)}")
    return values, max(map(len, written.groups("")))


def _number(text: str, lowest: float, highest: float) -> float:
    """The number in ASCII digits."""
    if not _NUMBER.fullmatch(text) or not lowest <= float(text) <= highest:
        raise ValueError(f"'{text[:40]}' is no number within {lowest:g} … {highest:g}")
    return float(text)


@final
@dataclass(frozen=True, slots=True)
class ReplyTag:
    """An element of the configuration's RECEIVE section: dotted or plain tag, and its type."""

    tag: str
    kind: str


@final
class ReplyFormat:
    """Writes replies from a template: constant text with places for six corrections, the stop and the IPOC."""

    def __init__(self, template: str) -> None:
        self.template = template

    @classmethod
    def of(cls, sentype: str, tags: tuple[ReplyTag, ...], correction: str, stop: str) -> ReplyFormat:
        """The format for the tags of a RECEIVE section, in its order; tags of others are sent as zero."""
        places = {f"{correction}.{name}": f"{{{i}:.{DECIMALS}f}}" for i, name in enumerate(AXIS_NAMES)} | {
            stop: "{6:d}"
        }
        elements: dict[str, dict[str, str]] = {}
        for tag in tags:
            head, _, attribute = tag.tag.removeprefix("DEF_").partition(".")
            elements.setdefault(head, {}).update(_contents(tag, attribute, places))
        body = "".join(_element(head, contents) for head, contents in elements.items())
        return cls(f"<Sen Type={_constant(quoteattr(sentype))}>{body}<IPOC>{{7}}</IPOC></Sen>")

    def write(self, correction: Correction, stop: bool, ipoc_text: str) -> bytes:
        """The reply: corrections of A1…A6 in degrees, the stop, and the count of the telegram answered."""
        return self.template.format(*correction, stop, ipoc_text).encode()


def _contents(tag: ReplyTag, attribute: str, places: dict[str, str]) -> dict[str, str]:
    if tag.tag.startswith("DEF_Tech."):
        return {f"{attribute}{i}": "0.000000" for i in range(1, 11)}
    return {attribute: places.get(tag.tag) or _ZERO[tag.kind]}


_ZERO = {"DOUBLE": "0.000000", "LONG": "0", "BOOL": "0", "STRING": ""}


def _element(head: str, contents: dict[str, str]) -> str:
    text = contents.get("", "")
    attributes = "".join(f' {name}="{value}"' for name, value in contents.items() if name)
    return f"<{head}{attributes}>{text}</{head}>" if text or not attributes else f"<{head}{attributes}/>"


def _constant(text: str) -> str:
    return text.replace("{", "{{").replace("}", "}}")


@final
class CorrectionMode(StrEnum):
    """How the controller's program switches RSI on; the address must agree."""

    ABSOLUTE = "absolute"
    """Each cycle's value is the offset from the pose at RSI_ON; zero returns to it."""

    RELATIVE = "relative"
    """Each cycle's value is added to the sum of those before; zero is standstill."""

    @property
    def holdon(self) -> str:
        """The only HOLDON of the six corrections that stops the robot after a missing answer.

        Absolute and 0: the output falls to zero, a leap back to the start. Relative and 1: the last increment is added
        again in every cycle.
        """
        return "1" if self is CorrectionMode.ABSOLUTE else "0"


@final
class WrittenCorrections:
    """The values to write in each cycle so that the set-point is at a given offset from the pose at RSI_ON.

    Relative: the offset less the sum written so far, as rounded on the wire, so that roundings do not accumulate.
    An increment in a late answer is lost and not repeated: the controller's sum lags behind ours, and the
    robot stops short of a limit, never beyond. `short_deg`: its largest lag, as length of the path.
    """

    def __init__(self, mode: CorrectionMode) -> None:
        self._mode = mode
        self._sum: Correction = (0.0,) * AXES
        self._last: Correction = (0.0,) * AXES
        self.short_deg = 0.0

    def leading_to(self, offset: Correction) -> Correction:
        """The values of A1…A6 to write now, degrees."""
        if self._mode is CorrectionMode.ABSOLUTE:
            return offset
        # + 0.0: no minus sign before a zero
        steps = tuple(round(to - at, DECIMALS) + 0.0 for to, at in zip(offset, self._sum, strict=True))
        self._sum = tuple(at + step for at, step in zip(self._sum, steps, strict=True))
        self._last = steps
        return steps

    def not_taken(self) -> None:
        """The controller may not have taken the last values."""
        self.short_deg += math.hypot(*self._last)
