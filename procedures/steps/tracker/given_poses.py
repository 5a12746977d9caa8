"""Measuring poses from a file of targets, as `cellctl plan` writes it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self, final

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.formats import DataSet, RobotFile
from cellctl.formats.dataset import Sieve, joint_readings
from cellctl.kinematics import Floats
from cellctl.planning.measuring_poses import MeasuringArm, unmeasurable
from cellctl.planning.ways import Reach

_CURE = "plan the targets for this cell's station and reflector, or move the station"


@final
@dataclass(frozen=True, eq=False)
class GivenPoses:
    """The targets of a file. readings (N, n), deg; sets, lines (N,); reasons: place → why it cannot be measured."""

    file: str
    readings: Floats
    sets: tuple[str, ...]
    lines: tuple[int, ...]
    reasons: dict[int, str]

    @classmethod
    def read(cls, file: Path, robot: RobotFile, arm: MeasuringArm, reach: Reach) -> Self:
        """Raises InputError with every row whose joints cannot be read."""
        data = DataSet.load(file)
        sieve = Sieve(data)
        readings = np.round(joint_readings(sieve, robot), 4)
        if sieve.rejected():
            raise InputError(Problem(data.file, row.line, 0, row.reason) for row in sieve.rejected())
        return cls(data.file, readings, tuple(data.texts("set")), data.lines, unmeasurable(arm, reach, readings))

    def first(self, fit: int, held_out: int) -> Floats:
        """The first postures (fit + held_out, n) of sets `fit` and `test` that can be measured. Raises InputError if a
        set has too few, with every row that cannot be measured.
        """
        chosen: list[int] = []
        for name, count in (("fit", fit), ("test", held_out)):
            usable = [place for place, of in enumerate(self.sets) if of == name and place not in self.reasons]
            if len(usable) < count:
                raise InputError(self._too_few(name, len(usable), count))
            chosen.extend(usable[:count])
        return self.readings[chosen]

    def _too_few(self, name: str, found: int, count: int) -> list[Problem]:
        what = f"{found} targets of set '{name}' can be measured; the procedure asks for {count}"
        own = [place for place in self.reasons if self.sets[place] == name]
        refused = (
            Problem(self.file, self.lines[place], 0, f"cannot be measured: {self.reasons[place]}", _CURE)
            for place in own
        )
        return [Problem(self.file, 0, 0, what, "plan more of them, or ask for fewer poses"), *refused]
