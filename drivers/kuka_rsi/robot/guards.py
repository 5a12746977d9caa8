"""Proof of life of other devices, in slots that the cyclic process checks in each cycle."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from cellctl.devices import Guard
from drivers.kuka_rsi.cyclic.shared_block import GUARDS, SharedBlock, Slot

ENGINE = "engine"
"""The engine's own beat, which guards every search."""

_OLDEST_ENGINE_BEAT_S = 0.25


@final
class GuardSlots:
    """The guards that beat, by slot; `block`: the shared block in use, replaced at a reconnection."""

    def __init__(self, device: str, block: Callable[[], SharedBlock | None]) -> None:
        self._device = device
        self._block = block
        self._slots = {ENGINE: 0}

    @property
    def names(self) -> tuple[str, ...]:
        """Names by slot."""
        return tuple(self._slots)

    def guard(self, name: str) -> Guard:
        """The slot of `name`, always the same one. Raises ValueError if all are taken."""
        slot = self._slots.setdefault(name, len(self._slots))
        if slot >= GUARDS:
            del self._slots[name]
            raise ValueError(f"{self._device}: no more than {GUARDS - 1} guards")
        return _SlotGuard(self._block, slot)

    def oldest_ns(self, guards: dict[str, float]) -> tuple[int, ...]:
        """Oldest beat allowed per slot, from names and seconds; 0 if a slot is unused."""
        oldest = [0] * GUARDS
        for name, seconds in {ENGINE: _OLDEST_ENGINE_BEAT_S, **guards}.items():
            self.guard(name)
            oldest[self._slots[name]] = round(seconds * 1e9)
        return tuple(oldest)


@final
class _SlotGuard:
    """Writes beats to a slot of the shared block in use."""

    def __init__(self, block: Callable[[], SharedBlock | None], slot: int) -> None:
        self._block = block
        self._place = Slot.BEATS + slot

    def beat(self, time_ns: int) -> None:
        """The device was alive at `time_ns` of the cell's clock."""
        if block := self._block():
            block.words[self._place] = time_ns
