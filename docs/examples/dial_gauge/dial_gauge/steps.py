"""The steps of the dial gauge's campaign, and the rows that they record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from cellctl.devices import JointReader
from cellctl.procedure import NoInputs, StepContext, StepInputs, StepResult, step
from cellctl.records import Row, VerdictRow
from dial_gauge.driver import LengthSource


@dataclass(frozen=True)
class LengthRow(Row):
    """A reading, mm, at `time_s` of the cell's clock, and the robot's joints, deg; none in a cell without a robot."""

    KIND: ClassVar[str] = "dial_gauge_length"
    MEASUREMENT: ClassVar[bool] = True
    number: int
    time_s: float
    mm: float
    joints: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class DriftVerdict(VerdictRow):
    """How far the readings spread: the greatest less the least, mm."""

    SECTION: ClassVar[tuple[str, ...]] = ("dial_gauge_mm",)
    dial_gauge_mm: float


class PlanInputs(StepInputs):
    """How many readings to take."""

    readings: int


class Plan(StepResult):
    """The numbers of the readings."""

    numbers: list[int]


def _passes(known: Mapping[str, Any]) -> int:
    """The passes of the loop over `Plan.numbers`, for the time left; 0 while the input is not known."""
    return int(known.get("readings", 0))


@step("dial_gauge.plan", title="planning the readings", expects=_passes)
async def plan(context: StepContext, inputs: PlanInputs) -> Plan:
    """Number the readings."""
    return Plan(numbers=list(range(1, inputs.readings + 1)))


class ReadInputs(StepInputs):
    """Which reading this is, and how long to wait before it, s."""

    number: int
    wait_s: float = 0.0


@step(
    "dial_gauge.read",
    needs={"gauge": LengthSource},
    uses={"robot": JointReader},
    title="reading the gauge",
)
async def read(context: StepContext, inputs: ReadInputs) -> None:
    """Read the gauge, and the robot's joints where the cell has a robot."""
    gauge: LengthSource = context.device("gauge")
    robot: JointReader | None = context.optional_device("robot")
    await context.clock.sleep(inputs.wait_s)
    joints = await robot.joints() if robot else ()
    await context.record(LengthRow(inputs.number, context.clock.now(), await gauge.length(), joints))


@step("dial_gauge.judge", title="judging the readings", verdict=DriftVerdict)
async def judge(context: StepContext, inputs: NoInputs) -> None:
    """State how far the readings spread."""
    lengths = [row.mm for row in context.recorded(LengthRow)]
    spread = max(lengths) - min(lengths)
    sentence = f"{len(lengths)} readings within {spread:.3f} mm."
    await context.record(DriftVerdict(verdict="measured", sentence=sentence, dial_gauge_mm=spread))
