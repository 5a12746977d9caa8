"""The true calibration spheres: spacings as certified, the plate slightly off its place in the cell file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from sims.cell import Artefact
from sims.world.certified import certified
from sims.world.errors import generator, unit_vector
from sims.world.nominal import turn, vector
from sims.world.screws import Vector

SHIFT_MM = 2.0
TURN_DEG = 0.3


@final
@dataclass(frozen=True, slots=True)
class TrueSphere:
    """A sphere and the tip that touches it: `touch_mm` is the distance TCP – sphere centre at contact."""

    id: str
    centre: Vector
    touch_mm: float


def true_spheres(artefact: Artefact, seed: int, scale: float) -> list[TrueSphere]:
    """Spacings true to their certificate (drawn with its σ), the whole moved by 2 mm and 0.3°, times `scale`."""
    random = generator(seed, "placement")
    rough = {sphere.id: sphere.centre for sphere in artefact.spheres}
    centres = certified(rough, artefact.distances, random, scale)
    if len(centres):
        middle = centres.mean(axis=0)
        rotation = turn(scale * TURN_DEG * unit_vector(random))
        centres = (centres - middle) @ rotation.T + middle + scale * SHIFT_MM * unit_vector(random)
    return [
        TrueSphere(sphere.id, vector(centre), sphere.diameter / 2.0 + artefact.tip_radius)
        for sphere, centre in zip(artefact.spheres, centres, strict=True)
    ]


def true_plate_z(artefact: Artefact, spheres: Sequence[TrueSphere]) -> float | None:
    """The true height of the plate: its mean distance below the spheres is the cell file's. None without a plate."""
    if artefact.plate is None or not spheres:
        return None
    raised = [true.centre[2] - rough.centre[2] for true, rough in zip(spheres, artefact.spheres, strict=True)]
    return artefact.plate.z + sum(raised) / len(raised)
