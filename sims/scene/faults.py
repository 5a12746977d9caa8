"""What can go wrong in the scene, whatever devices there are."""

from sims.scene.safety import SAFETY_FAULTS
from sims.settings import FaultKind, Setting

TIP_JUMP = FaultKind(
    "tip.jump",
    "the tip is shorter from then on, as after a collision of the wire",
    (Setting("mm", "number", 0.5, 0.0, what="By how much the tip is shorter."),),
    momentary=True,
)
SCENE_FAULTS = (TIP_JUMP, *SAFETY_FAULTS)
