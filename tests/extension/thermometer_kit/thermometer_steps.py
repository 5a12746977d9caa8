"""The step of the invented thermometer, and its row."""

from dataclasses import dataclass
from typing import ClassVar

from thermometer_driver import TemperatureSource

from cellctl.procedure import StepContext, StepInputs, StepResult, step
from cellctl.records import Row


@dataclass(frozen=True)
class TemperatureRow(Row):
    """A temperature of the cell, °C."""

    KIND: ClassVar[str] = "temperature"
    MEASUREMENT: ClassVar[bool] = True
    number: int
    celsius: float


class ReadInputs(StepInputs):
    """How many readings to take."""

    readings: int


class Readings(StepResult):
    """The last temperature, °C."""

    celsius: float


@step("thermometer.read", needs={"thermometer": TemperatureSource}, title="reading the temperature")
async def read(context: StepContext, inputs: ReadInputs) -> Readings:
    """Read the temperature of the cell several times."""
    source = context.device("thermometer")
    for number in range(1, inputs.readings + 1):
        celsius = await source.temperature()
        await context.record(TemperatureRow(number, celsius))
        await context.clock.sleep(0.5)
    return Readings(celsius=celsius)
