"""What a device's simulator is: one description with its settings and faults, and what it is started with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Protocol, final
from urllib.parse import parse_qsl, urlencode, urlsplit

from sims.section import Section

if TYPE_CHECKING:
    from sims.cell import SimCell
    from sims.faults import Faults
    from sims.kernel import Kernel
    from sims.memory import Memory
    from sims.scene.scene import Scene
    from sims.wires import Wire


@final
@dataclass(frozen=True, slots=True)
class Setting:
    """One setting: `Setting("cycle_ms", "whole", 4, among=(4, 12))`.

    `default`: where the file has none; None: whoever takes it knows what that means. `least`: the smallest number
    (a whole number is never below 0). `among`: the only values. `step`: of which a number is a multiple. `what`: one
    sentence for people.
    """

    name: str
    kind: Literal["number", "whole", "word"]
    default: float | str | None = None
    least: float | None = None
    among: tuple[float | str, ...] = ()
    step: int | None = None
    what: str = ""

    def read(self, section: Section) -> Any:
        """Its value in a section of the cell file; errors are noted there."""
        if section.entries.get(self.name) is None:
            return self.default
        if self.kind == "word":
            return section.word(self.name, among=[str(word) for word in self.among])
        if self.kind == "whole":
            value: float = section.whole(self.name, least=int(self.least or 0))
        else:
            value = section.number(self.name, least=-float("inf") if self.least is None else self.least)
        if self.among and value not in self.among:
            section.note(self.name, f"{' or '.join(map(str, self.among))} is expected, not {value}")
        if self.step and value % self.step:
            section.note(self.name, f"a multiple of {self.step} is expected, not {value}")
        return value

    def schema(self) -> dict[str, Any]:
        """What the JSON Schema says of it."""
        kinds = {"number": "number", "whole": "integer", "word": "string"}
        found: dict[str, Any] = {
            "description": self.what or None,
            **({"enum": list(self.among)} if self.among else {"type": kinds[self.kind]}),
            "minimum": None if self.among else self.least if self.kind != "whole" else self.least or 0,
            "multipleOf": self.step,
            "default": self.default,
        }
        return {key: value for key, value in found.items() if value is not None}


FOR_MS = Setting("for_ms", "number", None, 0.0, what="Without it a fault stays.")


@final
@dataclass(frozen=True, slots=True)
class FaultKind:
    """A fault that there can be. `momentary`: it happens and is over, only its start is reported."""

    name: str
    what: str
    settings: tuple[Setting, ...] = ()
    momentary: bool = False


def read_settings(settings: tuple[Setting, ...], section: Section) -> dict[str, Any]:
    """Name → value of each setting; errors, and unknown keys, are noted in the section."""
    section.only(setting.name for setting in settings)
    return {setting.name: setting.read(section) for setting in settings}


class CannotStart(ValueError):
    """The device cannot be simulated with this cell file; the text gives the reason."""


class Refused(Exception):
    """A request on the control port that cannot be done; the text gives the reason."""


Request = Callable[[dict[str, Any]], object]
"""Does what a message on the control port asks of one device. Raises Refused."""


@final
@dataclass(frozen=True, kw_only=True)
class Setup:
    """What a simulator is started with.

    `device`: its name in the cell file; `address`: as written there. `settings`: of its section, all with a value.
    `wire`: where it counts its bytes. `memory`: what outlives the process; each part of it has a name of its own.
    """

    device: str
    address: str
    settings: Mapping[str, Any]
    cell: SimCell
    kernel: Kernel
    scene: Scene
    faults: Faults
    wire: Wire
    memory: Memory


class Started(Protocol):
    """A device that listens."""

    @property
    def address(self) -> str:
        """The address for its driver: as written, with host and port or path filled in."""

    @property
    def requests(self) -> Mapping[str, Request]:
        """What it can be asked on the control port: `op` → request."""

    def close(self) -> None:
        """Hang up, and let go of ports and terminals."""


def _no_errors(address: str) -> list[str]:
    return []


@final
@dataclass(frozen=True, kw_only=True)
class Simulator:
    """One kind of device. Importing it costs nothing: `start` imports the rest.

    `schemes`: of the addresses that it stands in for. `start` raises CannotStart, BadMemory. `section`: the key of its
    `settings` in `simulate:`. `address_errors`: what is wrong with an address. `events`: name → when the simulator
    announces it to the fault schedule (`faults.announce`). `most`: how many of the kind a cell may have; None: any.
    """

    schemes: tuple[str, ...]
    start: Callable[[Setup], Started]
    section: str = ""
    settings: tuple[Setting, ...] = ()
    faults: tuple[FaultKind, ...] = ()
    events: Mapping[str, str] = field(default_factory=dict)
    address_errors: Callable[[str], list[str]] = _no_errors
    most: int | None = 1


def with_settings(address: str, place: str, **settings: str) -> str:
    """The address with this host and port, and settings added or replaced."""
    parts = urlsplit(address)
    query = {**dict(parse_qsl(parts.query)), **settings}
    return f"{parts.scheme}://{place}{parts.path}?{urlencode(query, safe='/:')}"


def with_path(address: str, path: str) -> str:
    """The address with this path and no host."""
    parts = urlsplit(address)
    return f"{parts.scheme}://{path}" + (f"?{parts.query}" if parts.query else "")
