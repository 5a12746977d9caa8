"""The user's RSI Ethernet configuration, which the controller loads; it defines the format of the answer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import final
from xml.parsers import expat

from drivers.kuka_rsi import AXIS_NAMES
from drivers.kuka_rsi.cyclic.telegram import CorrectionMode, ReplyTag
from drivers.kuka_rsi.settings import RsiSettings

_KINDS = ("BOOL", "LONG", "DOUBLE", "STRING")
_MOST_CHANNELS = 64

_NEEDED_IN_SEND = {
    "DEF_AIPos": ("DOUBLE", "the actual joints"),
    "DEF_Delay": ("LONG", "the controller's count of late answers: without it nobody knows which ones it took"),
}
"""Tags that the controller must send: type, and why."""

_WITHOUT_HOLDON = {
    CorrectionMode.ABSOLUTE: "one late answer would send the robot back to its start",
    CorrectionMode.RELATIVE: "while answers are late, the robot would go on by the last increment in every cycle",
}


@final
@dataclass(slots=True)
class XmlNode:
    """An element with the line on which it starts; `path`: tags from the root, `ROOT/CONFIG/PORT`."""

    path: str
    line: int
    attributes: dict[str, str]
    text: str = ""


@final
@dataclass(frozen=True, slots=True)
class EthernetConfig:
    """The file's content (`send`, `receive`: tags in their order), and its errors (`file:line: what`; empty: valid)."""

    sentype: str = ""
    send: tuple[str, ...] = ()
    receive: tuple[ReplyTag, ...] = ()
    errors: list[str] = field(default_factory=list)


def read_ethernet_config(settings: RsiSettings) -> EthernetConfig:
    """Read and check the configuration file that `settings` names; never raises for its content."""
    file = settings.ethernet
    try:
        nodes = _nodes(file)
    except OSError as error:
        return EthernetConfig(errors=[f"{file}: {error.strerror}"])
    except expat.ExpatError as error:
        return EthernetConfig(errors=[f"{file}:{error.lineno}: not XML: {expat.ErrorString(error.code)}"])
    if nodes[0].path != "ROOT":
        what = f"the root is <{nodes[0].path}>; an RSI Ethernet configuration has <ROOT>"
        return EthernetConfig(errors=[f"{file}:{nodes[0].line}: {what}"])
    found = chain(_in_config(nodes, settings.bind[1]), _in_send(nodes), _in_receive(nodes, settings))
    errors = [f"{file}:{line}: {what}" for line, what in sorted(found)]
    receive = tuple(ReplyTag(_tag(node), _kind(node)) for node in _elements(nodes, "RECEIVE"))
    return EthernetConfig(_text(nodes, "SENTYPE"), tuple(map(_tag, _elements(nodes, "SEND"))), receive, errors)


Errors = Iterable[tuple[int, str]]


def _nodes(file: Path) -> list[XmlNode]:
    nodes: list[XmlNode] = []
    open_nodes: list[XmlNode] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        path = f"{open_nodes[-1].path}/{tag}" if open_nodes else tag
        open_nodes.append(XmlNode(path, parser.CurrentLineNumber, attributes))
        nodes.append(open_nodes[-1])

    def text(data: str) -> None:
        open_nodes[-1].text += data

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: open_nodes.pop()
    parser.CharacterDataHandler = text
    parser.Parse(file.read_bytes(), True)
    return nodes


def _in_config(nodes: list[XmlNode], bound_port: int) -> Errors:
    if not _text(nodes, "SENTYPE"):
        yield _line(nodes, "CONFIG/SENTYPE"), "SENTYPE is missing or empty: the controller takes no answer without it"
    if _text(nodes, "ONLYSEND").upper() != "FALSE":
        yield _line(nodes, "CONFIG/ONLYSEND"), "ONLYSEND must be FALSE: otherwise the controller takes no corrections"
    port = _text(nodes, "PORT")
    if bound_port and port != str(bound_port):
        yield (
            _line(nodes, "CONFIG/PORT"),
            f"PORT is {port or 'missing'}, the address binds {bound_port}: no telegram would come",
        )


def _in_send(nodes: list[XmlNode]) -> Errors:
    elements = _elements(nodes, "SEND")
    by_tag = {_tag(node): node for node in elements}
    for tag, (kind, why) in _NEEDED_IN_SEND.items():
        node = by_tag.get(tag)
        element = f'<ELEMENT TAG="{tag}" TYPE="{kind}" INDX="INTERNAL"/>'
        if node is None:
            yield _line(nodes, "SEND"), f"SEND lacks {tag} ({why}); add {element}"
        elif _kind(node) != kind or node.attributes.get("INDX") != "INTERNAL":
            yield node.line, f"{tag} ({why}) must be {element}"
    yield from _twice(elements, "TAG")


def _in_receive(nodes: list[XmlNode], settings: RsiSettings) -> Errors:
    elements = _elements(nodes, "RECEIVE")
    by_tag = {_tag(node): node for node in elements}
    wanted = {f"{settings.correction}.{axis}": "DOUBLE" for axis in AXIS_NAMES} | {settings.stop: "BOOL"}
    for tag, kind in wanted.items():
        node = by_tag.get(tag)
        if node is None:
            yield _line(nodes, "RECEIVE"), f"RECEIVE lacks {tag} ({kind})"
        elif _kind(node) != kind:
            yield node.line, f"{tag} is {_kind(node) or 'of no type'}, not {kind}"
        elif kind == "DOUBLE" and node.attributes.get("HOLDON") != settings.mode.holdon:
            yield node.line, f'{tag} has no HOLDON="{settings.mode.holdon}": {_WITHOUT_HOLDON[settings.mode]}'
        elif kind == "BOOL" and node.attributes.get("HOLDON") != "0":
            yield node.line, f'{tag} has no HOLDON="0": the stop of one search would be held into the next'
    for node in elements:
        yield from _in_received(node)
    yield from _twice(elements, "TAG")
    yield from _twice([node for node in elements if not _internal(node)], "INDX")


def _in_received(node: XmlNode) -> Errors:
    if not _tag(node):
        yield node.line, "an ELEMENT has no TAG"
    if _tag(node) == "DEF_Tech.T1":
        yield node.line, "DEF_Tech.T1 is RSI's own function generator; use DEF_Tech.T2"
    if _kind(node) not in _KINDS:
        yield node.line, f"{_tag(node)}: TYPE '{_kind(node)}' is none of {', '.join(_KINDS)}"
    index = node.attributes.get("INDX", "")
    if not _internal(node) and not (index.isascii() and index.isdigit() and 0 < int(index) <= _MOST_CHANNELS):
        yield node.line, f"{_tag(node)}: INDX '{index}' is no channel (1 … {_MOST_CHANNELS}, or INTERNAL)"


def _twice(elements: list[XmlNode], attribute: str) -> Errors:
    first: dict[str, int] = {}
    for node in elements:
        value = node.attributes.get(attribute, "")
        if value in first:
            yield node.line, f"{attribute} {value} stands on line {first[value]} already"
        first.setdefault(value, node.line)


def _elements(nodes: list[XmlNode], section: str) -> list[XmlNode]:
    return [node for node in nodes if node.path == f"ROOT/{section}/ELEMENTS/ELEMENT"]


def _tag(node: XmlNode) -> str:
    return node.attributes.get("TAG", "")


def _kind(node: XmlNode) -> str:
    return node.attributes.get("TYPE", "")


def _internal(node: XmlNode) -> bool:
    return node.attributes.get("INDX") == "INTERNAL" or _tag(node).startswith("DEF_")


def _text(nodes: list[XmlNode], name: str) -> str:
    return next((node.text.strip() for node in nodes if node.path == f"ROOT/CONFIG/{name}"), "")


def _line(nodes: list[XmlNode], name: str) -> int:
    """The place of `CONFIG/PORT`, else of the element that should contain it."""
    place = f"ROOT/{name}"
    lines = {node.path: node.line for node in reversed(nodes)}
    while place not in lines:
        place = place.rpartition("/")[0]
    return lines[place]
