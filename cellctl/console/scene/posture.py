"""The robot of the scene: its links at its last recorded posture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cellctl.console.scene.setting import Setting
from cellctl.journal import RunState
from cellctl.kinematics import Floats

_FIELDS = ("resting", "at_contact", "joints", "commanded")
"""Fields of rows that hold readings, the latest in time first."""


@final
@dataclass(frozen=True, eq=False)
class Posture:
    """The nominal robot. readings (n,), deg; source: where they are from, in words.

    frames (n + 2, 4, 4), robot's base frame, mm: behind joints 1 … n, each with its z along the joint's axis, then
    flange and TCP.
    """

    readings: tuple[float, ...]
    source: str
    frames: Floats


def posture_of(state: RunState, setting: Setting) -> Posture | None:
    """The robot at the last readings in the journal, else at home of the cell file, else at zero; None: no robot."""
    if setting.chain is None or setting.joints is None:
        return None
    readings, source = _last(state, setting.chain.n) or _assumed(setting)
    frames = setting.chain.frames(setting.joints.model(np.array(readings)))
    tcp = frames[-1] @ setting.chain.tool
    return Posture(readings, source, np.concatenate([frames, tcp[None]]))


def _last(state: RunState, n: int) -> tuple[tuple[float, ...], str] | None:
    for row in reversed(state.rows):
        readings = _readings(row.event.data, n)
        if readings is not None:
            number = row.event.data.get("number")
            return (
                readings,
                f"recorded with {row.event.row_kind.replace('_', ' ')}{'' if number is None else f' {number}'}",
            )
    return None


def _readings(data: Mapping[str, Any], n: int) -> tuple[float, ...] | None:
    for name in _FIELDS:
        value = data.get(name)
        if isinstance(value, list | tuple) and len(value) == n and all(isinstance(one, int | float) for one in value):
            return tuple(float(one) for one in value)
    return None


def _assumed(setting: Setting) -> tuple[tuple[float, ...], str]:
    assert setting.chain is not None
    if len(setting.home) == setting.chain.n:
        return setting.home, "home of the cell file: nothing is recorded yet"
    return (0.0,) * setting.chain.n, "all joints at zero: nothing is recorded yet"
