"""What a form cannot hold: its name, and the distance of the TCP that it costs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, final

from cellctl.formats.measured_postures import measured_postures

if TYPE_CHECKING:
    from cellctl.formats.model import ModelFile
    from cellctl.kinematics import Floats, SerialChain


@final
@dataclass(frozen=True, slots=True)
class Cost:
    """Distance of the exported form's TCP from the model's, mm, over `postures` postures of the measured region."""

    rms_mm: float
    max_mm: float
    postures: int

    @classmethod
    def of(cls, chain: SerialChain, q: Floats, goal: Floats) -> Self:
        """Of a chain's TCP at model angles q (N, n), rad, from that of poses `goal` (N, 4, 4), mm."""
        import numpy as np

        distances = np.linalg.norm((chain.forward(q) - goal)[:, :3, 3], axis=1)
        return cls(float(np.sqrt(np.mean(distances**2))), float(distances.max()), len(distances))

    @property
    def words(self) -> str:
        """For people."""
        return f"{self.rms_mm:.3f} mm RMS, {self.max_mm:.3f} mm at most, over {self.postures} postures"

    def figures(self) -> dict[str, Any]:
        """For the JSON."""
        return {"rms_mm": self.rms_mm, "max_mm": self.max_mm, "postures": self.postures}


def effects_left_out(model: ModelFile) -> dict[str, bool]:
    """Titles of the effects with amounts other than 0, which a form of geometry alone lacks.

    The value is whether a `Cost` counts it: not where it needs a temperature or currents.
    """
    import numpy as np

    identified, at = model.robot_model(), measured_postures(model)
    chain, deviations = len(identified.chain.parameters), identified.deviations
    start, found = chain, {}
    for effect in identified.effects:
        end = start + len(effect.parameters)
        if deviations[start:end].any():
            alone = np.zeros(len(deviations))
            alone[:chain], alone[start:end] = deviations[:chain], deviations[start:end]
            moved = identified.with_deviations(alone).tcp(at) - identified.chain.forward(at.q)[:, :3, 3]
            found[effect.title.lower()] = bool(np.abs(moved).max() > 1e-9)
        start = end
    return found
