"""Documents of the transfer channel (docs/reference/eki-channel.md): split from the stream, read, written."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import final
from xml.etree import ElementTree

from cellctl.devices import JointReadings
from drivers.kuka_rsi.axes import AXIS_NAMES

LARGEST_DOCUMENT = 4096

_TOKEN = re.compile(
    rb"""<!--.*?-->|<\?.*?\?>|<!\[CDATA\[.*?\]\]>|<(?P<tag>/?[^\s<>!?/"'](?:[^<>"']|"[^"]*"|'[^']*')*)>""", re.DOTALL
)


@final
@dataclass(frozen=True, slots=True)
class Reply:
    """`<Rep>`: `code` as in the reference; `joints` actual, degrees, if sent; `ident` of HELLO.

    `document`: the complete reply, for elements that only some commands have.
    """

    id: int
    code: int
    text: str
    joints: JointReadings | None
    ident: dict[str, str]
    document: ElementTree.Element = field(default_factory=lambda: ElementTree.Element("Rep"), compare=False)


@final
@dataclass(frozen=True, slots=True)
class Stat:
    """`<Stat>`: operating mode, program state, standing message, actual joints in degrees."""

    mode: str
    program: str
    message: str
    joints: JointReadings


@final
class DocumentStream:
    """Splits a stream of XML documents at the end of each root element, for any TCP segmentation."""

    def __init__(self) -> None:
        self._buffer = b""
        self._scanned = 0
        self._depth = 0

    def feed(self, data: bytes) -> list[bytes]:
        """The documents that `data` completes. Raises ValueError if one exceeds 4 KiB."""
        self._buffer += data
        documents = []
        while end := self._end_of_document():
            self._refuse_longer(end)
            documents.append(self._buffer[:end].strip())
            self._buffer = self._buffer[end:].lstrip()
            self._scanned = self._depth = 0
        self._refuse_longer(len(self._buffer))
        return documents

    @staticmethod
    def _refuse_longer(size: int) -> None:
        if size > LARGEST_DOCUMENT:
            raise ValueError(f"a document of more than {LARGEST_DOCUMENT} bytes")

    def _end_of_document(self) -> int:
        while (at := self._buffer.find(b"<", self._scanned)) >= 0:
            token = _TOKEN.match(self._buffer, at)
            if token is None:
                self._scanned = at
                return 0
            self._scanned = token.end()
            if self._closes_root(token["tag"]):
                return token.end()
        return 0

    def _closes_root(self, tag: bytes | None) -> bool:
        if tag is None:
            return False
        if not tag.endswith(b"/"):
            self._depth += -1 if tag.startswith(b"/") else 1
        return self._depth <= 0


def read_document(document: bytes) -> Reply | Stat:
    """Read one document of the controller. Raises ValueError if it is neither `<Rep>` nor `<Stat>`."""
    try:
        root = ElementTree.fromstring(document)
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"not XML: {error}") from None
    joints = _joints(root.find("Q"))
    if root.tag == "Rep":
        ident = root.find("Ident")
        return Reply(
            _integer(root, "Id"),
            _integer(root, "Code"),
            root.get("Text", ""),
            joints,
            dict(ident.attrib if ident is not None else {}),
            root,
        )
    if root.tag == "Stat" and joints is not None:
        return Stat(root.get("Mode", ""), root.get("Prog", ""), root.get("Msg", ""), joints)
    raise ValueError(f"<{root.tag}> is no reply and no state")


def write_command(number: int, operation: str, content: str = "") -> bytes:
    """`<Cmd>` with the given content."""
    return f'<Cmd Id="{number}" Op="{operation}">{content}</Cmd>'.encode()


def point_to_point(target: JointReadings, speed_percent: float) -> str:
    """Content of `PTP`: speed in percent of each axis' maximum, target in degrees."""
    axes = " ".join(f'{name}="{value:.4f}"' for name, value in zip(AXIS_NAMES, target, strict=True))
    return f'<Vel P="{speed_percent:.4f}"/><Q {axes}/>'


def _joints(element: ElementTree.Element | None) -> JointReadings | None:
    if element is None or not element.attrib:
        return None
    values = tuple(float(element.get(name, "nan")) for name in AXIS_NAMES)
    if not all(map(math.isfinite, values)):
        raise ValueError("Q lacks an axis")
    return values


def _integer(element: ElementTree.Element, name: str) -> int:
    return int(element.get(name, ""))
