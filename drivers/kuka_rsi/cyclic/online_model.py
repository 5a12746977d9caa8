"""The joint correction that makes the identified robot reach the nominal robot's TCP pose: one model, from its arrays.

The step itself, its equations and its damping: `online_kernel`. From δ = 0 three steps leave less than 1 µm; from one
cycle to the next δ changes by some 0.1 mm at 100 deg/s, and one step leaves 3 µm of that at most.

q are the model's angles, rad: sign · reading + offset of each axis. The correction goes back by the sign alone, as the
offset cancels in a difference.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from drivers.kuka_rsi import AXES
from drivers.kuka_rsi.cyclic.online_block import unpack
from drivers.kuka_rsi.cyclic.online_kernel import Chains, Effects, Floats, newton_step


@final
class OnlineModel:
    """The corrections of one model. `values`: as `pack` made them. Raises ValueError where it did not.

    `last_rad`: correction of the model angles to begin with.
    """

    def __init__(self, values: Sequence[float], last_rad: Sequence[float] | None = None) -> None:
        arrays = {name: list(part) for name, part in unpack(values).items()}
        self._lower, self._upper = arrays["lower"], arrays["upper"]
        self._fade_deg = arrays["fade"][0]
        self._sign, self._offset = arrays["sign"], arrays["offset"]
        self._chains, self._effects = _chains(arrays), _effects(arrays)
        self._q, self._last = np.zeros(AXES), np.array([0.0] * AXES if last_rad is None else last_rad)
        newton_step(self._chains, self._effects, self._q, self._last)  # from here on it is compiled

    @property
    def last_rad(self) -> tuple[float, ...]:
        """The last correction of the model angles, rad: the start of the next step."""
        return tuple(self._last.tolist())

    def inside(self, readings: Sequence[float]) -> float:
        """1 within the measured region, falling smoothly to 0 at the fade width outside it. readings: A1…A6, deg."""
        beyond = 0.0
        for low, reading, high in zip(self._lower, readings, self._upper, strict=True):
            beyond = max(beyond, low - reading, reading - high)
        share = max(0.0, 1.0 - beyond / self._fade_deg)
        return share * share * (3.0 - 2.0 * share)

    def is_within(self, limit_deg: float) -> bool:
        """Whether all axes of the correction stay within `limit_deg` somewhere in the measured region: in its middle,
        or at one of 64 joints spread over it.
        """
        last, spread = self._last, random.Random(0)
        shares = [[0.5] * AXES, *([spread.random() for _ in range(AXES)] for _ in range(64))]
        try:
            return any(max(map(abs, self._settled(share))) <= limit_deg for share in shares)
        finally:
            self._last = last

    def _settled(self, share: Sequence[float]) -> tuple[float, ...]:
        """The correction, deg, at a share of the measured region in each axis, from zero: three steps leave 1 µm."""
        readings = [low + part * (high - low) for low, part, high in zip(self._lower, share, self._upper, strict=True)]
        self._last = np.zeros(AXES)
        return [self.correction(readings) for _ in range(3)][-1]

    def correction(self, readings: Sequence[float]) -> tuple[float, ...]:
        """The correction of A1…A6, deg, at the programmed joints `readings`, deg, one step from the last cycle's."""
        for joint, reading in enumerate(readings):
            self._q[joint] = self._sign[joint] * math.radians(reading) + self._offset[joint]
        self._last = newton_step(self._chains, self._effects, self._q, self._last)
        return tuple(sign * math.degrees(last) for sign, last in zip(self._sign, self._last.tolist(), strict=True))


def _chains(arrays: Mapping[str, list[float]]) -> Chains:
    """Both chains, counted from the nominal robot's base."""
    nominal, true = (_frames(arrays[name]) for name in ("links", "identified"))
    base, tool = _frames(arrays["base"])[0], _frames(arrays["tool"])[0]
    to_base = np.ascontiguousarray(base[:, :3].T)
    true[0, :, 3] -= base[:, 3]
    true[0] = to_base @ true[0]
    return Chains(nominal, true, tool, to_base @ np.reshape(arrays["identified_base"], (3, 3)))


def _effects(arrays: Mapping[str, list[float]]) -> Effects:
    joints, orders = (np.array(arrays[f"wave_{each}"], dtype=int) for each in ("joint", "order"))
    waves = np.zeros((AXES, orders.max(initial=0)), dtype=complex)
    factors = np.array(arrays["wave_cosine"]) - 1j * np.array(arrays["wave_sine"])
    np.add.at(waves, (joints, waves.shape[1] - orders), factors)
    return Effects(
        down=np.array(arrays["down"]),
        load=np.array(arrays["load"]),
        load_place=np.array(arrays["load_place"]),
        bend=np.array(arrays["bend"]),
        stretch=np.array(arrays["stretch"]),
        weight=np.reshape(arrays["weight"], (AXES, 2, AXES)),
        waves=waves,
        node_place=np.reshape(arrays["node_place"], (-1, AXES)),
        node_scale=np.reshape(arrays["node_scale"], (-1, AXES)),
        node_weight=np.reshape(arrays["node_weight"], (3, -1)),
    )


def _frames(matrices: Sequence[float]) -> Floats:
    return np.reshape(matrices, (-1, 4, 4))[:, :3].copy()
