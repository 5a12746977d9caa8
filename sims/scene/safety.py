"""What can go wrong in the scene, whatever devices there are, and its safety chain: emergency stop, guard."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from sims.faults import Faults
from sims.settings import FOR_MS, FaultKind, Setting

EMERGENCY_STOP = FaultKind("safety.emergency_stop", "somebody presses the emergency stop", (FOR_MS,))
GUARD_OPEN = FaultKind("safety.guard_open", "somebody opens the guard door", (FOR_MS,))
SAFETY_FAULTS = (EMERGENCY_STOP, GUARD_OPEN)


@final
class Safety:
    """The chain: `emergency_stop_ok` and `guard_closed`; both are true on a healthy cell.

    It is wired to the robot controller, not led over a bus: who subscribes is called in the same instant.
    `motion_enabled`: an output of the PLC to the robot controller. It is no part of the chain.
    """

    def __init__(self, faults: Faults) -> None:
        self.emergency_stop_ok = self.guard_closed = self.motion_enabled = True
        self._callbacks: list[Callable[[], object]] = []
        faults.on_start(EMERGENCY_STOP.name, self.open_emergency_stop)
        faults.on_end(EMERGENCY_STOP.name, self.close_emergency_stop)
        faults.on_start(GUARD_OPEN.name, self.open_guard)
        faults.on_end(GUARD_OPEN.name, self.close_guard)

    @property
    def ok(self) -> bool:
        """Whether the chain is closed."""
        return self.emergency_stop_ok and self.guard_closed

    def subscribe(self, callback: Callable[[], object]) -> None:
        """Call `callback` at each change."""
        self._callbacks.append(callback)

    def open_emergency_stop(self) -> None:
        """The emergency stop is pressed."""
        self._set(False, self.guard_closed, self.motion_enabled)

    def close_emergency_stop(self) -> None:
        """The emergency stop is released."""
        self._set(True, self.guard_closed, self.motion_enabled)

    def open_guard(self) -> None:
        """The guard door is opened."""
        self._set(self.emergency_stop_ok, False, self.motion_enabled)

    def close_guard(self) -> None:
        """The guard door is closed."""
        self._set(self.emergency_stop_ok, True, self.motion_enabled)

    def enable_motion(self, enabled: bool) -> None:
        """The PLC gives its enable to the robot controller, or drops it."""
        self._set(self.emergency_stop_ok, self.guard_closed, enabled)

    def _set(self, *state: bool) -> None:
        if state == (self.emergency_stop_ok, self.guard_closed, self.motion_enabled):
            return
        self.emergency_stop_ok, self.guard_closed, self.motion_enabled = state
        for callback in self._callbacks:
            callback()


TIP_JUMP = FaultKind(
    "tip.jump",
    "the tip is shorter from then on, as after a collision of the wire",
    (Setting("mm", "number", 0.5, 0.0, what="By how much the tip is shorter."),),
    momentary=True,
)
STATION_BUMP = FaultKind(
    "station.bump",
    "the instrument is moved and turned, in directions by seed, and stays there",
    (
        Setting("mm", "number", 1.0, 0.0, what="By how much it is moved."),
        Setting("deg", "number", 0.02, 0.0, what="By how much it is turned."),
    ),
    momentary=True,
)
REFLECTOR_WRONG = FaultKind(
    "reflector.wrong",
    "another kind of reflector is in use, on the robot and in the nests: its constant differs from the file's",
    (Setting("mm", "number", 5.0, 0.0, what="By how much its constant is greater."), FOR_MS),
)
SCENE_FAULTS = (TIP_JUMP, STATION_BUMP, REFLECTOR_WRONG, *SAFETY_FAULTS)
