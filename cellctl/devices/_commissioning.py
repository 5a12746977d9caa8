"""Steps of a cell's commissioning, as drivers and packages of campaigns contribute them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, final, runtime_checkable

from cellctl.clock import Clock
from cellctl.devices._protocols import Device
from cellctl.files import Document


@final
@dataclass(frozen=True, slots=True)
class Figure:
    """A measured value with its limit: `Figure("stop_ms", "time to standstill", 31.2, "ms", most=150.0)`.

    `name`: in the record, the same from call to call. `least`, `most`: the limits of a number; `wanted`: the only good
    text, empty for any. A value of None was not measured: the device does not report it.
    """

    name: str
    title: str
    value: int | float | str | None
    unit: str = ""
    least: float | None = None
    most: float | None = None
    wanted: str = ""

    @property
    def ok(self) -> bool:
        """Whether the value is within its limit. A text or None never violates a limit of numbers."""
        if isinstance(self.value, str):
            return self.wanted in ("", self.value)
        if self.value is None:
            return True
        return (self.least is None or self.value >= self.least) and (self.most is None or self.value <= self.most)

    @property
    def text(self) -> str:
        """The value with its unit: four digits of a fraction, whole numbers in full."""
        if self.value is None:
            return "not reported"
        if isinstance(self.value, str):
            return f"{self.value} {self.unit}".rstrip()
        return f"{self.value:.4g} {self.unit}".rstrip() if self.value % 1 else f"{self.value:.0f} {self.unit}".rstrip()

    @property
    def limit(self) -> str:
        """The limit as text; empty without one."""
        if self.wanted:
            return self.wanted
        low, high = (f"{bound:g}" if bound is not None else "" for bound in (self.least, self.most))
        if low and high:
            return f"{low} … {high}"
        return f"at least {low}" if low else f"at most {high}" if high else ""


class Person(Protocol):
    """Somebody at the cell, who does by hand what a step asks for.

    `action`: the same for a simulated cell, where the simulator of `device` does it (request `by_hand`): `touch`;
    `reset` closes the safety chain and acknowledges all messages.
    """

    async def asked(self, text: str, device: str, action: str) -> None:
        """Ask for `text`, and wait until it is said to be done."""

    async def told(self, text: str, device: str, action: str) -> None:
        """Ask for `text`; the device will show that it is done."""


@final
@dataclass(frozen=True, slots=True)
class CommissioningStep:
    """A step of the first hour at a cell.

    `id`: unique in its device. `does`: what happens, for who confirms it. `next_needs`: what later steps rely on.
    `moves`: the robot moves; such steps come last, each confirmed by name at the terminal. `run` measures; it raises
    the device's errors.
    """

    id: str
    title: str
    does: str
    next_needs: str
    run: Callable[[Person], Awaitable[Sequence[Figure]]]
    moves: bool = False


@runtime_checkable
class Commissioned(Protocol):
    """A device whose driver contributes steps to the commissioning of its cell."""

    def commissioning(self) -> tuple[CommissioningStep, ...]:
        """The steps, in their order. They are run after `connect`."""


@runtime_checkable
class SlowlyMoved(Protocol):
    """A robot whose controller has a mode of slow motion under an enabling switch; its commissioning moves in that."""

    @property
    def slow_mode(self) -> str:
        """The mode as `Health.mode` names it, as T1."""


@final
@dataclass(frozen=True, slots=True)
class CellSteps:
    """Steps that need several devices, or the cell file; entry point group `cellctl.commissioning`.

    `of(cell, robot_file, devices, clock)`: the steps that this cell can do, none if it lacks a device.
    """

    of: Callable[[Document, Path, Mapping[str, Device], Clock], tuple[CommissioningStep, ...]]
