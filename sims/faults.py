"""Faults: what goes wrong, and when. The devices' simulators ask whether one is active, or are told when it starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, final

from sims.kernel import Kernel

SETTINGS: dict[str, frozenset[str]] = {
    "rsi.silent": frozenset(),
    "rsi.sentype": frozenset(),
    "rsi.stall": frozenset({"for_ms"}),
    "rsi.drop": frozenset({"for_ms"}),
    "robot.stop": frozenset(),
    "robot.restart": frozenset(),
    "tip.jump": frozenset({"mm"}),
    "probe.closed": frozenset({"for_ms"}),
    "probe.wire_break": frozenset({"for_ms"}),
    "probe.silent": frozenset({"for_ms"}),
    "probe.reset": frozenset(),
    "probe.no_contact": frozenset({"for_ms"}),
    "probe.corrupt": frozenset({"every", "for_ms"}),
}
"""Fault → its settings, besides those that say when."""

MOMENTARY = frozenset({"robot.stop", "robot.restart", "tip.jump", "probe.reset"})
"""Faults that happen and are over: only their start is told."""

_WHEN = ("search", "before_search", "at_ms")
_MS = 1_000_000


class FaultError(ValueError):
    """A fault that there is not, or a setting that it does not have; the text says which are possible."""


@final
@dataclass(frozen=True, slots=True)
class FaultSetting:
    """One fault of the schedule.

    At most one of `search` (counted from 1, with `after_ms`), `before_search` and `at_ms` says when; none means at
    once. `for_ms`: how long; None stays. `every`: each how many lines one is corrupted. `mm`: by how much the tip is
    shorter.
    """

    fault: str
    search: int | None = None
    before_search: int | None = None
    at_ms: float | None = None
    after_ms: float = 0.0
    for_ms: float | None = None
    every: int = 1
    mm: float = 0.5


def read_fault(entry: Mapping[str, Any]) -> FaultSetting:
    """A fault as the cell file or the control port writes it. Raises FaultError."""
    name = entry.get("fault")
    if not isinstance(name, str) or name not in SETTINGS:
        raise FaultError(f"there is no fault '{name}'; there are {', '.join(sorted(SETTINGS))}")
    allowed = {"fault", *_WHEN, "after_ms", *SETTINGS[name]}
    for key in entry:
        if key not in allowed:
            raise FaultError(f"{name} has no setting '{key}'; it has {', '.join(sorted(allowed - {'fault'}))}")
    if sum(key in entry for key in _WHEN) > 1:
        raise FaultError(f"{name}: only one of {', '.join(_WHEN)} can say when")
    if "after_ms" in entry and "search" not in entry:
        raise FaultError(f"{name}: after_ms counts from the start of a search; say which with 'search'")
    for key in entry.keys() - {"fault"}:
        _check_number(f"{name}: {key}", entry[key], whole=key in {"search", "before_search", "every"})
    return FaultSetting(**entry)


def _check_number(what: str, value: object, *, whole: bool) -> None:
    if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
        raise FaultError(f"{what} is a {'whole ' if whole else ''}number, not {value!r}")
    if whole and value < 1:
        raise FaultError(f"{what} counts from 1, not {value}")
    if not 0 <= value < float("inf"):
        raise FaultError(f"{what} is not negative, and finite, not {value}")


@final
class Faults:
    """The schedule of faults on the cell's time, and the count of searches."""

    def __init__(self, kernel: Kernel) -> None:
        self.searches = 0
        self._kernel = kernel
        self._active: dict[str, list[FaultSetting]] = {name: [] for name in SETTINGS}
        self._on_start: dict[str, list[Callable[[], object]]] = {name: [] for name in SETTINGS}
        self._on_end: dict[str, list[Callable[[], object]]] = {name: [] for name in SETTINGS}
        self._waiting: list[FaultSetting] = []
        self._ended = 0

    def schedule(self, setting: FaultSetting) -> None:
        """Put a fault on the schedule. Raises FaultError where the search it belongs to has begun."""
        number = setting.search or setting.before_search
        if number is not None and number <= self.searches:
            raise FaultError(f"{setting.fault}: search {number} has begun already")
        if setting.search is not None or (setting.before_search or 0) > self._ended + 1:
            self._waiting.append(setting)
        else:
            self._kernel.at(round((setting.at_ms or 0.0) * _MS), partial(self._start, setting))

    def active(self, name: str) -> FaultSetting | None:
        """The fault of this name that is going on, the latest of several; None where all is well."""
        settings = self._active[name]
        return settings[-1] if settings else None

    def on_start(self, name: str, callback: Callable[[], object]) -> None:
        """Call `callback` whenever a fault of this name starts, within its event."""
        self._on_start[name].append(callback)

    def on_end(self, name: str, callback: Callable[[], object]) -> None:
        """Call `callback` whenever a fault of this name ends by its `for_ms`, within its event."""
        self._on_end[name].append(callback)

    def search_begins(self) -> int:
        """RSI is on for a search; returns its number, from 1."""
        self.searches += 1
        for setting in [setting for setting in self._waiting if setting.search == self.searches]:
            self._waiting.remove(setting)
            self._kernel.after(round(setting.after_ms * _MS), partial(self._start, setting))
        return self.searches

    def search_ends(self) -> None:
        """The search's last reply has been sent: what is due before the next one starts."""
        self._ended = self.searches
        for setting in [setting for setting in self._waiting if setting.before_search == self._ended + 1]:
            self._waiting.remove(setting)
            self._start(setting)

    def _start(self, setting: FaultSetting) -> None:
        self._active[setting.fault].append(setting)
        for callback in self._on_start[setting.fault]:
            callback()
        if setting.for_ms is not None:
            self._kernel.after(round(setting.for_ms * _MS), partial(self._end, setting))
        elif setting.fault in MOMENTARY:
            self._end(setting)

    def _end(self, setting: FaultSetting) -> None:
        self._active[setting.fault].remove(setting)
        for callback in self._on_end[setting.fault]:
            callback()
