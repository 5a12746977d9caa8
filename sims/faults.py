"""Faults and their schedule. The devices' simulators query whether one is active, or are called when it starts.

A fault starts at a time of the cell, or at an event, which a device's simulator announces by its name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, final

from sims.kernel import Kernel
from sims.settings import FaultKind

MOVE, SEARCH, SEARCH_END = "robot.move", "robot.search", "robot.search_end"
"""Events of a robot controller; `search:` and `before_search:` mean the last two."""

WHEN = ("event", "search", "before_search", "at_ms")
_COUNTS = {"count", "search", "before_search"}
_MS = 1_000_000


class FaultError(ValueError):
    """An unknown fault, or an unknown setting of one; the text lists the possible ones."""


@final
@dataclass(frozen=True, slots=True)
class Trigger:
    """When a fault starts: at a time of the cell, or `after_ms` after the `count`-th `event` (None: within it).

    `last`: the event, with its count, before which the fault must be on the schedule.
    """

    at_ms: float = 0.0
    event: str | None = None
    count: int = 1
    after_ms: float | None = 0.0
    last: tuple[str, int] = ("", 1)


@final
@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of the schedule. `settings`: name → value, None where nothing is stated (`for_ms`: it stays)."""

    kind: FaultKind
    trigger: Trigger
    settings: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Of its kind: `probe.wire_break`."""
        return self.kind.name


@final
class FaultCatalogue:
    """The faults that there are, and the events at which they can start."""

    def __init__(self, kinds: Iterable[FaultKind], events: Iterable[str]) -> None:
        self.kinds = {kind.name: kind for kind in kinds}
        self.events = tuple(dict.fromkeys(events))

    def read(self, entry: Mapping[str, Any]) -> Fault:
        """A fault as the cell file or the control port writes it. Raises FaultError."""
        name = entry.get("fault")
        kind = self.kinds.get(name) if isinstance(name, str) else None
        if kind is None:
            raise FaultError(f"there is no fault '{name}'; there are {', '.join(sorted(self.kinds))}")
        own = {setting.name: setting for setting in kind.settings}
        allowed = {*WHEN, "count", "after_ms", *own}
        for key, value in entry.items():
            if key == "fault":
                continue
            if key not in allowed:
                raise FaultError(f"{name} has no setting '{key}'; it has {', '.join(sorted(allowed))}")
            if key != "event":
                whole = key in _COUNTS or (key in own and own[key].kind == "whole")
                _check_number(f"{name}: {key}", value, whole=whole)
        settings = {setting.name: entry.get(setting.name, setting.default) for setting in kind.settings}
        return Fault(kind, self._trigger(kind.name, entry), settings)

    def _trigger(self, name: str, entry: Mapping[str, Any]) -> Trigger:
        if sum(key in entry for key in WHEN) > 1:
            raise FaultError(f"{name}: only one of {', '.join(WHEN)} can say when")
        if "after_ms" in entry and not entry.keys() & {"event", "search"}:
            raise FaultError(f"{name}: after_ms counts from an event; say which with 'event'")
        if "count" in entry and "event" not in entry:
            raise FaultError(f"{name}: count is of events; say which with 'event'")
        if "before_search" in entry:
            number = entry["before_search"]
            return Trigger(event=SEARCH_END, count=number - 1, after_ms=None, last=(SEARCH, number))
        if not entry.keys() & {"event", "search"}:
            return Trigger(at_ms=entry.get("at_ms", 0.0))
        event, count = entry.get("event", SEARCH), entry.get("search", entry.get("count", 1))
        if "event" in entry and event not in self.events:
            known = ", ".join(self.events) or "none"
            raise FaultError(f"{name}: no device of this cell has the event '{event}'; there are {known}")
        return Trigger(event=event, count=count, after_ms=entry.get("after_ms", 0.0), last=(event, count))


def _check_number(what: str, value: object, *, whole: bool) -> None:
    if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
        raise FaultError(f"{what} is a {'whole ' if whole else ''}number, not {value!r}")
    if whole and value < 1:
        raise FaultError(f"{what} counts from 1, not {value}")
    if not 0 <= value < float("inf"):
        raise FaultError(f"{what} is not negative, and finite, not {value}")


@final
class Faults:
    """The schedule of faults on the cell's time, and the count of each event."""

    def __init__(self, kernel: Kernel, catalogue: FaultCatalogue) -> None:
        self.catalogue = catalogue
        self.counts: Counter[str] = Counter()
        self._kernel = kernel
        self._active: dict[str, list[Fault]] = {name: [] for name in catalogue.kinds}
        self._on_start: dict[str, list[Callable[[], object]]] = {name: [] for name in catalogue.kinds}
        self._on_end: dict[str, list[Callable[[], object]]] = {name: [] for name in catalogue.kinds}
        self._waiting: list[Fault] = []

    def schedule(self, fault: Fault) -> None:
        """Put a fault on the schedule. Raises FaultError where its event is over."""
        trigger = fault.trigger
        event, count = trigger.last
        if self.counts[event] >= count:
            raise FaultError(f"{fault.name}: {event} {count} has begun already")
        if trigger.event is None or self.counts[trigger.event] >= trigger.count:
            self._kernel.at(round(trigger.at_ms * _MS), partial(self._start, fault))
        else:
            self._waiting.append(fault)

    def active(self, name: str) -> Fault | None:
        """The active fault of this name, the latest of several; None without one."""
        faults = self._active[name]
        return faults[-1] if faults else None

    def on_start(self, name: str, callback: Callable[[], object]) -> None:
        """Call `callback` whenever a fault of this name starts, within its event."""
        self._on_start[name].append(callback)

    def on_end(self, name: str, callback: Callable[[], object]) -> None:
        """Call `callback` whenever a fault of this name ends by its `for_ms`, within its event."""
        self._on_end[name].append(callback)

    def announce(self, event: str) -> int:
        """A device reports that `event` happens now; returns its count, from 1. Raises KeyError: not described."""
        if event not in self.catalogue.events:
            raise KeyError(f"{event} is not among the events of its device's description")
        self.counts[event] += 1
        due = [fault for fault in self._waiting if self._is_due(fault.trigger, event)]
        for fault in due:
            self._waiting.remove(fault)
            if fault.trigger.after_ms is None:
                self._start(fault)
            else:
                self._kernel.after(round(fault.trigger.after_ms * _MS), partial(self._start, fault))
        return self.counts[event]

    def _is_due(self, trigger: Trigger, event: str) -> bool:
        return trigger.event == event and trigger.count == self.counts[event]

    def _start(self, fault: Fault) -> None:
        self._active[fault.name].append(fault)
        for callback in self._on_start[fault.name]:
            callback()
        for_ms = fault.settings.get("for_ms")
        if for_ms is not None:
            self._kernel.after(round(for_ms * _MS), partial(self._end, fault))
        elif fault.kind.momentary:
            self._end(fault)

    def _end(self, fault: Fault) -> None:
        self._active[fault.name].remove(fault)
        for callback in self._on_end[fault.name]:
            callback()
