"""The loop as the probe's converter sees it: contacts that bounce, a broken wire, a tip that never closes."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import final

from sims.faults import Faults
from sims.kernel import Event, Kernel
from sims.scene.contact_loop import ContactLoop

CLOSED_MV = 40
OPEN_MV = 1650
BROKEN_MV = 4950

BOUNCE_NS = (50_000, 1_000_000)
"""Between these after the edge a contact opens and closes again."""


def bounce_delays(draw: random.Random, edges: int) -> list[int]:
    """When the further edges of a contact come, ns after the first."""
    return sorted(draw.sample(range(*BOUNCE_NS), edges))


@final
class Circuit:
    """Turns the loop and its faults into a voltage; `on_change(millivolts)` at the exact time of each change."""

    def __init__(self, kernel: Kernel, loop: ContactLoop, faults: Faults, seed: int, bounce: int) -> None:
        self.on_change: Callable[[int], object] = lambda millivolts: None
        self._kernel = kernel
        self._faults = faults
        self._bounce = bounce
        self._draw = random.Random(f"{seed} bounce")
        self._touching = loop.closed
        self._bouncing: list[Event] = []
        self.millivolts = self._voltage()
        loop.subscribe(self._contact)
        for name in ("probe.closed", "probe.wire_break", "probe.no_contact"):
            faults.on_start(name, self._settle)
            faults.on_end(name, self._settle)

    def _contact(self, closed: bool) -> None:
        for event in self._bouncing:
            event.cancel()
        self._bouncing = [self._kernel.after(delay, self._toggle) for delay in bounce_delays(self._draw, self._bounce)]
        self._touching = closed
        self._settle()

    def _toggle(self) -> None:
        self._touching = not self._touching
        self._settle()

    def _settle(self) -> None:
        millivolts = self._voltage()
        if millivolts != self.millivolts:
            self.millivolts = millivolts
            self.on_change(millivolts)

    def _voltage(self) -> int:
        if self._faults.active("probe.wire_break"):
            return BROKEN_MV
        if self._faults.active("probe.closed"):
            return CLOSED_MV
        touching = self._touching and not self._faults.active("probe.no_contact")
        return CLOSED_MV if touching else OPEN_MV
