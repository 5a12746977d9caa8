"""What an engine does in tests of faults in mid-correction: slow moves there and back, corrected by a model."""

from __future__ import annotations

from cellctl.devices import CorrectionModel
from drivers.kuka_rsi.robot.kuka_robot import KukaRobot
from tests.helpers.online_models import wavy_model

MODEL = CorrectionModel("m1", {name: tuple(values) for name, values in wavy_model(0.5, span_deg=170.0).items()})
HERE, THERE = (5.0, -65.0, 95.0, 5.0, 65.0, 5.0), (15.0, -60.0, 90.0, 15.0, 75.0, -15.0)
PERCENT = 4.0


async def corrected_from_here(robot: KukaRobot) -> None:
    """Bring it to HERE, and switch the correction on."""
    await robot.move(HERE, 50)
    await robot.correction_on(MODEL)


async def there_and_back(robot: KukaRobot) -> None:
    """Until something stops it."""
    for target in (THERE, HERE) * 20:
        await robot.move(target, PERCENT)
