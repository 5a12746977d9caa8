"""Errors of a robot at its postures, ready for an analysis: repeats averaged, too few or constant rows refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.kinematics import Floats

LEAST_POSTURES = 20
"""Fewer postures give fewer than 190 pairs: less than ten for each of the 20 bins of a semivariogram."""

MOVES_DEG = 0.05
"""A joint whose readings have a smaller standard deviation counts as one that never moves."""

CONSTANT_MM = 1e-6
"""A component of the errors with a smaller standard deviation is constant: it was computed, not measured."""

_SAME_DEG = 1e-6


@final
class UnsuitableRows(Exception):
    """The rows do not allow an analysis; the text is what is wrong, ": " and the cure."""


@final
@dataclass(frozen=True, slots=True, eq=False)
class ErrorSet:
    """Errors at N different postures.

    readings (N, n), deg; places (N, 3): nominal TCP, mm; errors (N, 3): measured less nominal, mm, both in the robot's
    base frame. repeats: rows averaged away, as they repeat a posture.
    """

    readings: Floats
    places: Floats
    errors: Floats
    repeats: int = 0

    @classmethod
    def of(cls, readings: Floats, places: Floats, errors: Floats) -> ErrorSet:
        """From rows, several of which may have one posture: these are averaged, so that no pair has distance 0.

        Raises UnsuitableRows for fewer than 20 postures, for errors that are constant in every component (positions
        were computed, not measured), and where no joint moves.
        """
        _, first, of = np.unique(np.round(readings / _SAME_DEG), axis=0, return_index=True, return_inverse=True)
        order = np.argsort(first)
        place_of = np.argsort(order)[of.reshape(-1)]
        count = np.bincount(place_of)[:, None]
        mean = np.stack([np.bincount(place_of, errors[:, axis]) for axis in range(3)], axis=1) / count
        chosen = first[order]
        found = cls(readings[chosen], places[chosen], mean, len(readings) - len(chosen))
        found._refuse()
        return found

    def __len__(self) -> int:
        return len(self.readings)

    @property
    def moving(self) -> tuple[bool, ...]:
        """Which joints (n,) move."""
        return tuple((self.readings.std(axis=0) > MOVES_DEG).tolist())

    @property
    def varying(self) -> tuple[bool, ...]:
        """Which components (x, y, z) of the errors vary."""
        return tuple((self.errors.std(axis=0) > CONSTANT_MM).tolist())

    def _refuse(self) -> None:
        if len(self) < LEAST_POSTURES:
            repeated = f" ({self.repeats} rows repeat one of them)" if self.repeats else ""
            what = f"{len(self)} different postures{repeated} are too few for 20 bins of pairs"
            raise UnsuitableRows(f"{what}: measure at {LEAST_POSTURES} postures or more, better 50")
        if not any(self.varying):
            what = "the errors are the same in all rows to 0.000001 mm, so X, Y, Z were computed and not measured"
            raise UnsuitableRows(f"{what}: fill in what the instrument measured")
        if not any(self.moving):
            raise UnsuitableRows(f"no joint moves by more than {MOVES_DEG}°: measure at different postures")
