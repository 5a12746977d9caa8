"""The robot's position and state, stored from one process to the next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, final

from sims.scene.motions import Joints
from sims.world.screws import Vector


@final
@dataclass(frozen=True, slots=True)
class Stance:
    """Joints as they really are, degrees; the programmed ones; the scatter that goes with them, mm (None: to be drawn).

    `attempts`: how often each pose has been commanded, by its joints in 1e-4°; `attempt`: which one this is, from 0.
    `slack`: how far each link is ahead of its joint within the play, degrees; `sliding`: each joint's share of its
    Coulomb friction; none where nothing is known of them.
    """

    joints: Joints
    commanded: Joints
    scatter: Vector | None = None
    attempt: int = 0
    attempts: Mapping[str, int] = field(default_factory=dict)
    slack: Joints = ()
    sliding: Joints = ()

    def state(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "joints": self.joints,
            "commanded": self.commanded,
            "scatter": self.scatter,
            "attempt": self.attempt,
            "attempts": dict(self.attempts),
            "slack": self.slack,
            "sliding": self.sliding,
        }


def stance_from(state: Mapping[str, Any], axes: int) -> Stance:
    """The stance of a `state` that was kept. Raises ValueError, TypeError, LookupError, AttributeError."""
    x, y, z = _numbers(state["scatter"], 3)
    return Stance(
        joints=_numbers(state["joints"], axes),
        commanded=_numbers(state["commanded"], axes),
        scatter=(x, y, z),
        attempt=int(state["attempt"]),
        attempts={str(pose): int(count) for pose, count in state["attempts"].items()},
        slack=_numbers(state["slack"], axes) if state.get("slack") else (),
        sliding=_numbers(state["sliding"], axes) if state.get("sliding") else (),
    )


def _numbers(values: Any, count: int) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if len(numbers) != count or not all(map(isfinite, numbers)):
        raise ValueError(f"{count} finite numbers are expected, not {values!r}")
    return numbers
