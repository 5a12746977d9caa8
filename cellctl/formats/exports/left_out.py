"""What a form cannot hold: its name, and the distance of the TCP that it costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, final

if TYPE_CHECKING:
    from cellctl.formats.model import ModelFile
    from cellctl.kinematics import Floats

DRAWN = 300
"""Postures drawn in the measured region of a model that keeps too few of its own."""
LEAST = 30
SEED = 20_131


@final
@dataclass(frozen=True, slots=True)
class Cost:
    """Distance of the exported form's TCP from the model's, mm, over `postures` postures of the measured region."""

    rms_mm: float
    max_mm: float
    postures: int

    @classmethod
    def of(cls, apart: Floats) -> Self:
        """From the differences (N, 3), mm."""
        import numpy as np

        distances = np.linalg.norm(apart, axis=1)
        return cls(float(np.sqrt(np.mean(distances**2))), float(distances.max()), len(distances))

    @property
    def words(self) -> str:
        """For people."""
        return f"{self.rms_mm:.3f} mm RMS, {self.max_mm:.3f} mm at most, over {self.postures} postures"

    def figures(self) -> dict[str, Any]:
        """For the JSON."""
        return {"rms_mm": self.rms_mm, "max_mm": self.max_mm, "postures": self.postures}


def measured_postures(model: ModelFile) -> Floats:
    """Readings (N, n), deg: the model's measured postures, or drawn over its joint region where it keeps few."""
    import numpy as np

    region = model.joint_region
    if region.postures and len(region.postures) >= LEAST:
        return np.array(region.postures)
    return np.random.default_rng(SEED).uniform(region.min, region.max, (DRAWN, model.robot.n))


def effects_left_out(model: ModelFile) -> list[str]:
    """Titles of the effects with amounts other than 0: a form that holds geometry alone lacks them."""
    identified = model.robot_model()
    start, found = len(identified.chain.parameters), []
    for effect in identified.effects:
        amounts = identified.deviations[start : (start := start + len(effect.parameters))]
        if amounts.any():
            found.append(effect.title.lower())
    return found


def cost_of(model: ModelFile, tcp: Callable[[Floats], Floats]) -> Cost:
    """Cost of a form whose TCP (N, 3), mm, in the model's frame, is `tcp` of the readings (N, n), deg.

    The model is that without payload, at the temperature of its lengths, with unknown approach.
    """
    readings = measured_postures(model)
    found = model.robot_model().tcp(model.robot.joint_map().model(readings))
    return Cost.of(tcp(readings) - found)
