"""RSI on the wire: the person's Ethernet configuration, `<Rob>` with the tags in its order, the PC's `<Sen>` read."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

from sims.krc._xml_documents import count, decimal, parse
from sims.simulator import CannotStart

TYPES = frozenset({"BOOL", "LONG", "DOUBLE", "STRING"})
AXES = tuple(f"A{i}" for i in range(1, 7))

_MOST_CHANNELS = 64
_FREE_TAG = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*(\.[A-Za-z0-9_-]+)?")
_INDEX = re.compile(r"[0-9]{1,2}")

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

LARGEST_IPOC = 10**15
LARGEST_VALUE = 3600.0
"""Of a correction, degrees: ten turns."""

_TRUTH = {"TRUE": 1.0, "FALSE": 0.0, "true": 1.0, "false": 0.0}


class BadConfig(CannotStart):
    """The configuration is not one that RSI_CREATE takes; the text names file and cause."""


@final
@dataclass(frozen=True, slots=True)
class Element:
    """One ELEMENT: `tag` as on the wire (without `DEF_`), its type, and whether it keeps its value when missed.

    `internal`: a `DEF_` tag, which RSI itself fills; the others go over a channel of the ETHERNET object.
    """

    tag: str
    type: str
    hold_on: bool
    internal: bool
    name: str = field(init=False)
    """The XML element, `AK` of `AK.A1`."""
    attribute: str = field(init=False)
    """The XML attribute, `A1` of `AK.A1`; empty where the value is the element's text."""

    def __post_init__(self) -> None:
        name, _, attribute = self.tag.partition(".")
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "attribute", attribute)


@final
@dataclass(frozen=True, slots=True)
class EthernetConfig:
    """CONFIG, SEND (robot → PC) and RECEIVE (PC → robot) of the file, in its order.

    `correction`: the six RECEIVE tags wired to AXISCORR; `stop`: the one wired to STOP, or None.
    """

    sentype: str
    only_send: bool
    send: tuple[Element, ...]
    receive: tuple[Element, ...]
    correction: tuple[str, ...]
    stop: str | None

    @property
    def wired(self) -> tuple[Element, ...]:
        """The RECEIVE tags that this controller's RSI context uses; others are accepted and have no effect."""
        return tuple(element for element in self.receive if element.tag in {*self.correction, self.stop})


def read_config(path: Path) -> EthernetConfig:
    """Read the file. Raises BadConfig."""
    try:
        root = ET.fromstring(path.read_bytes())
    except OSError as error:
        raise BadConfig(f"{path}: {error.strerror}") from None
    except ET.ParseError as error:
        raise BadConfig(f"{path}: not XML: {error}") from None
    sentype = (root.findtext("CONFIG/SENTYPE") or "").strip()
    if not sentype:
        raise BadConfig(f"{path}: CONFIG/SENTYPE is missing")
    only_send = (root.findtext("CONFIG/ONLYSEND") or "").strip().upper() == "TRUE"
    send, receive = _elements(path, root, "SEND"), _elements(path, root, "RECEIVE")
    correction = () if only_send else _correction(path, receive)
    stop = next((e.tag for e in receive if e.type == "BOOL" and e.tag.upper() == "STOP"), None)
    return EthernetConfig(sentype, only_send, send, receive, correction, stop)


def _elements(path: Path, root: ET.Element, section: str) -> tuple[Element, ...]:
    elements = [_element(path, section, entry) for entry in root.iterfind(f"{section}/ELEMENTS/ELEMENT")]
    tags = [element.tag for element in elements]
    if twice := next((tag for tag in tags if tags.count(tag) > 1), None):
        raise BadConfig(f"{path}: {section}: {twice} is there twice")
    return tuple(elements)


def _element(path: Path, section: str, entry: ET.Element) -> Element:
    tag, type_ = entry.get("TAG", ""), entry.get("TYPE", "")
    if not tag:
        raise BadConfig(f"{path}: {section}: an ELEMENT without TAG")
    if type_ not in TYPES:
        raise BadConfig(f"{path}: {section}: {tag}: TYPE is one of {', '.join(sorted(TYPES))}, not '{type_}'")
    internal = tag.startswith("DEF_")
    if not internal:
        _check_free(f"{path}: {section}: {tag}", tag, entry.get("INDX", ""))
    return Element(tag.removeprefix("DEF_"), type_, entry.get("HOLDON", "0").strip() == "1", internal)


def _check_free(where: str, tag: str, index: str) -> None:
    if not _FREE_TAG.fullmatch(tag):
        raise BadConfig(f"{where}: a TAG is NAME or NAME.ATTRIBUTE, of letters, digits, '_' and '-'")
    if index == "INTERNAL":
        raise BadConfig(f"{where}: INDX INTERNAL belongs to a tag that begins with DEF_; this one needs a channel")
    if not (_INDEX.fullmatch(index) and 1 <= int(index) <= _MOST_CHANNELS):
        raise BadConfig(f"{where}: Invalid index: INDX '{index}' is no channel 1 … {_MOST_CHANNELS}")


def _correction(path: Path, receive: tuple[Element, ...]) -> tuple[str, ...]:
    tags = {element.tag for element in receive if element.type == "DOUBLE"}
    for name in dict.fromkeys(element.name for element in receive):
        if f"{name}.E1" in tags:
            raise BadConfig(f"{path}: RECEIVE: {name}.E1: AXISCORREXT on a robot without external axes (RSIBad)")
        group = tuple(f"{name}.{axis}" for axis in AXES)
        if tags.issuperset(group):
            return group
    wanted = "six DOUBLE tags NAME.A1 … NAME.A6"
    if cartesian := next((element.name for element in receive if element.tag == f"{element.name}.X"), None):
        raise BadConfig(
            f"{path}: RECEIVE: {cartesian}.X … are Cartesian corrections (POSCORR), and this simulated controller "
            f"wires axis corrections (AXISCORR) only: put {wanted} in their place, AK.A1 … AK.A6 say"
        )
    raise BadConfig(f"{path}: RECEIVE: no {wanted} to wire to AXISCORR")


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


@final
@dataclass(frozen=True, slots=True)
class Reply:
    """An answer that could be read. `values`: tag → number, only of tags that it gave."""

    sentype: str
    ipoc: int
    values: dict[str, float]


def read_reply(data: bytes, wired: Sequence[Element]) -> Reply | None:
    """Read an answer by name, of the RECEIVE tags those `wired`; None where it is not an answer.

    That is: not XML, more than 8 KiB, no IPOC, or a wired tag whose value is no number of a possible size.
    """
    try:
        root = parse(data)
        if root.tag != "Sen":
            return None
        ipoc = count(root.findtext("IPOC", ""), LARGEST_IPOC)
        return Reply(root.get("Type", ""), ipoc, _values(root, wired))
    except ValueError:
        return None


def _values(root: ET.Element, wired: Sequence[Element]) -> dict[str, float]:
    children = {child.tag: child for child in root}
    values = {}
    for element in wired:
        child = children.get(element.name)
        if child is None:
            continue
        text = child.get(element.attribute) if element.attribute else child.text
        if text is not None:
            values[element.tag] = _number(text)
    return values


def _number(text: str) -> float:
    return _TRUTH[text] if text in _TRUTH else decimal(text, LARGEST_VALUE)
