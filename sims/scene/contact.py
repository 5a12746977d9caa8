"""The electrical loop between the robot's tip and the spheres, and the truth about each contact, for tests."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from math import dist
from typing import TextIO, final

from sims.scene.motions import Joints
from sims.world.kinematics import Vector
from sims.world.true_places import TrueSphere


@final
class ContactLoop:
    """Whether the tip touches. The controller's simulator sets it inside an event at the exact time."""

    def __init__(self) -> None:
        self.closed = False
        self._watchers: list[Callable[[bool], object]] = []

    def set_closed(self, closed: bool) -> None:
        """The tip touches or leaves now; a second call has no effect."""
        if closed == self.closed:
            return
        self.closed = closed
        for watcher in self._watchers:
            watcher(closed)

    def subscribe(self, callback: Callable[[bool], object]) -> None:
        """Call `callback(closed)` at each change, within the event that makes it."""
        self._watchers.append(callback)


@final
@dataclass(slots=True)
class _Contact:
    time_ns: int
    tcp: Vector
    joints: Joints
    sphere: TrueSphere
    worn_mm: float
    last: Vector
    overtravel_mm: float = 0.0


@final
class ContactLog:
    """Collects contacts from `begin` to `rest`; the tool's path after each is summed in `passed`.

    `out`: a text file, or None to write nothing.
    """

    def __init__(self, out: TextIO | None) -> None:
        self._out = out
        self._search: tuple[int, int] | None = None
        self._contacts: list[_Contact] = []

    @property
    def waiting(self) -> bool:
        """Whether a contact's over-travel is still being summed."""
        return bool(self._contacts)

    def begin(self, search: int, attempt: int) -> None:
        """A search begins from the pose that the robot went to for the `attempt`-th time."""
        self._search = (search, attempt)

    def touched(self, time_ns: int, joints: Joints, tcp: Vector, sphere: TrueSphere, worn_mm: float) -> None:
        """The tip, shorter by `worn_mm`, touches now; outside a search nothing is recorded."""
        if self._search and self._out:
            self._contacts.append(_Contact(time_ns, tcp, joints, sphere, worn_mm, tcp))

    def passed(self, tcp: Vector) -> None:
        """The tip is here now."""
        for contact in self._contacts:
            contact.overtravel_mm += dist(contact.last, tcp)
            contact.last = tcp

    def rest(self, time_ns: int) -> None:
        """The robot stands: the search is over."""
        if self._search and self._out:
            for contact in self._contacts:
                self._out.write(json.dumps(self._line(contact, time_ns, *self._search)) + "\n")
            self._out.flush()
        self._contacts.clear()
        self._search = None

    @staticmethod
    def _line(contact: _Contact, stopped_ns: int, search: int, attempt: int) -> dict[str, object]:
        return {
            "search": search,
            "attempt": attempt,
            "time_ns": contact.time_ns,
            "tcp": contact.tcp,
            "joints": contact.joints,
            "sphere": contact.sphere.id,
            "centre": contact.sphere.centre,
            "distance": dist(contact.tcp, contact.sphere.centre),
            "overtravel_mm": contact.overtravel_mm,
            "stopped_ns": stopped_ns,
            "worn_mm": contact.worn_mm,
        }
