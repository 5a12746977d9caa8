"""What can go wrong in the scene, whatever devices there are."""

from sims.scene.safety import SAFETY_FAULTS
from sims.settings import FOR_MS, FaultKind, Setting

TIP_JUMP = FaultKind(
    "tip.jump",
    "the tip is shorter from then on, as after a collision of the wire",
    (Setting("mm", "number", 0.5, 0.0, what="By how much the tip is shorter."),),
    momentary=True,
)
STATION_BUMP = FaultKind(
    "station.bump",
    "the instrument is moved and turned, in directions by seed, and stays there",
    (
        Setting("mm", "number", 1.0, 0.0, what="By how much it is moved."),
        Setting("deg", "number", 0.02, 0.0, what="By how much it is turned."),
    ),
    momentary=True,
)
REFLECTOR_WRONG = FaultKind(
    "reflector.wrong",
    "another kind of reflector is in use, on the robot and in the nests: its constant differs from the file's",
    (Setting("mm", "number", 5.0, 0.0, what="By how much its constant is greater."), FOR_MS),
)
SCENE_FAULTS = (TIP_JUMP, STATION_BUMP, REFLECTOR_WRONG, *SAFETY_FAULTS)
