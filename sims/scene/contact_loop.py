"""The electrical loop between the robot's tip and the spheres: closed by the world, watched by the probe."""

from __future__ import annotations

from collections.abc import Callable
from typing import final


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
