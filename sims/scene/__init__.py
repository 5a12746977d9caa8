"""What stands in the simulated cell: the world, the moving arm, and the contact between its tip and the spheres.

For the simulators of controllers: `MovingArm` is `setup.scene.arm`, `Safety` is `setup.scene.safety`; motions that the
arm follows fulfil `Motion`.
"""

from sims.scene.arm import MovingArm
from sims.scene.motions import Braking, Cycle, Motion, PointToPoint, Standing, State
from sims.scene.safety import Safety

__all__ = ["Braking", "Cycle", "Motion", "MovingArm", "PointToPoint", "Safety", "Standing", "State"]
