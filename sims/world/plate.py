"""The true calibration spheres: spacings as certified, the plate slightly off its place in the cell file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from sims.cell import Artefact
from sims.world.errors import generator, unit_vector
from sims.world.nominal import turn, vector
from sims.world.screws import Vector

SHIFT_MM = 2.0
TURN_DEG = 0.3
_STEPS = 50


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
    centres = _shaped(artefact, random, scale)
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


def _shaped(artefact: Artefact, random: np.random.Generator, scale: float) -> NDArray[np.float64]:
    """Centres nearest to the rough places whose distances are the drawn ones (weighted, where they contradict)."""
    rank = {sphere.id: i for i, sphere in enumerate(artefact.spheres)}
    pairs = [tuple(rank[name] for name in distance.between) for distance in artefact.distances]
    sigmas = np.array([distance.sigma for distance in artefact.distances])
    lengths = np.array([distance.mm for distance in artefact.distances]) + scale * random.normal(0.0, sigmas)
    weights = 1.0 / np.maximum(sigmas, 1e-6)
    centres = np.array([sphere.centre for sphere in artefact.spheres], dtype=float)
    for _ in range(_STEPS if pairs else 0):
        jacobian, spacings = _spacings(centres, pairs)
        step, *_ = np.linalg.lstsq(jacobian * weights[:, None], (lengths - spacings) * weights, rcond=None)
        centres += step.reshape(-1, 3)
        if np.abs(step).max() < 1e-9:
            break
    return centres


def _spacings(
    centres: NDArray[np.float64], pairs: Sequence[tuple[int, ...]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    jacobian = np.zeros((len(pairs), *centres.shape))
    spacings = np.zeros(len(pairs))
    for row, (i, j) in enumerate(pairs):
        apart = centres[i] - centres[j]
        spacings[row] = np.linalg.norm(apart)
        jacobian[row, i] = apart / spacings[row]
        jacobian[row, j] = -jacobian[row, i]
    return jacobian.reshape(len(pairs), -1), spacings
