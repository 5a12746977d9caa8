"""What a device's simulator is: one description with its settings and faults, and what it is started with.

The kinds of settings and faults are of `sims.settings`; a simulator takes them from here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, final
from urllib.parse import parse_qsl, urlencode, urlsplit

from sims.settings import FOR_MS, FaultKind, Setting

if TYPE_CHECKING:
    from sims.cell_content import SimCell
    from sims.faults import Faults
    from sims.kernel import Kernel
    from sims.memory import Memory
    from sims.scene.scene import Scene
    from sims.wires import Wire

__all__ = [
    "FOR_MS",
    "CannotStart",
    "FaultKind",
    "Refused",
    "Request",
    "Setting",
    "Setup",
    "Simulator",
    "Started",
    "with_path",
    "with_settings",
]


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
