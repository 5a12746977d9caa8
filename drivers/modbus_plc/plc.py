"""The PLC for campaigns: its place and limits, inputs, outputs, temperatures, weather, conditions of interlocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final, Self, final

from cellctl.clock import Clock
from cellctl.devices import (
    Address,
    CellReadings,
    CommissioningStep,
    DeviceBusy,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUnreachable,
    Figure,
    Health,
    Identity,
    Person,
    Temperatures,
    Weather,
    impossible_host,
)
from drivers.modbus_plc.io_map import EXCLUSIVE, INPUTS, OUTPUTS, Readings, WordOrder
from drivers.modbus_plc.line import ModbusLine
from drivers.modbus_plc.polling import CLAMP_TRAVEL_S, Poll, Polling, PollLimits

_EXAMPLE = "modbus+tcp://192.168.10.5:502?unit=1&words=high_first"
_PORT = 502
_WORDS: dict[str, WordOrder] = {"high_first": "high_first", "low_first": "low_first"}
_CEILINGS = {"age_s": 2.0, "heartbeat_s": 5.0}
_LEAST_S = 0.2


@final
@dataclass(frozen=True, slots=True)
class PlcPlace:
    """Host, port, unit id, and the order of the words of a 32-bit value."""

    host: str
    port: int
    unit: int
    words: WordOrder

    @classmethod
    def of(cls, address: Address) -> Self:
        """The place in an address. Raises ValueError for a missing host, a path, or a wrong setting."""
        if not address.host or address.path.strip("/"):
            raise ValueError(f"'{address}' has to name a host and no path, as {_EXAMPLE}")
        if why := impossible_host(address.host, reached=True):
            raise ValueError(f"'{address}': {why}")
        unknown = sorted(set(address.query) - {"unit", "words"})
        if unknown:
            raise ValueError(f"'{address}': the setting '{unknown[0]}' is not known; there are 'unit' and 'words'")
        unit = address.query.get("unit", "1")
        if not (unit.isascii() and unit.isdigit() and int(unit) <= 255):
            raise ValueError(f"'{address}': unit has to be a whole number from 0 to 255")
        words = _WORDS.get(address.query.get("words", "high_first"))
        if words is None:
            raise ValueError(f"'{address}': words has to be high_first or low_first")
        return cls(address.host, address.port or _PORT, int(unit), words)


def limits_of(stated: Mapping[str, float]) -> PollLimits:
    """The limits in the cell file; missing ones take the defaults. Raises ValueError."""
    for name, value in stated.items():
        if name not in _CEILINGS:
            raise ValueError(f"unknown limit '{name}'; there are {' and '.join(_CEILINGS)}")
        if not _LEAST_S <= value <= _CEILINGS[name]:
            raise ValueError(f"limit {name} {value:g} is outside {_LEAST_S:g} … {_CEILINGS[name]:g} s")
    return PollLimits(**stated)


_CONDITIONS: Final = {
    "alive": "the PLC answers and its program runs",
    "temperatures_ok": "no sensor of temperature, pressure or humidity is broken",
    **INPUTS,
}
_SENSOR_CURE = "check the sensor and its wire at the PLC's input module"
_CLAMP_CURE = "check both sensors of the tool clamp, and the air"


@final
class ModbusPlc:
    """A CellIO over Modbus TCP; its I/O map: docs/connecting-a-plc.md.

    The safety chain is hard-wired. Emergency stop and guard are inputs here, and nothing commands them.
    """

    def __init__(self, name: str, place: PlcPlace, clock: Clock, limits: PollLimits) -> None:
        self.name = name
        self._place, self._clock, self._limits = place, clock, limits
        self._polling: Polling | None = None

    async def connect(self) -> Identity:
        """Connect, poll once, read the identity. Raises DeviceUnreachable, DeviceRefused, DeviceFault."""
        await self.close()
        polling = Polling(self.name, self._clock, self._line, self._limits, self._place.words)
        try:
            line = await polling.start()
            identity = await self._identity(line)
        except BaseException as error:
            await polling.close()
            if isinstance(error, DeviceLost):
                raise DeviceUnreachable(self.name, error.what, error.cure) from error
            raise
        self._polling = polling
        return identity

    def commissioning(self) -> tuple[CommissioningStep, ...]:
        """Safety inputs by hand."""
        return _steps_of(self, self._clock)

    async def inputs(self) -> Mapping[str, bool]:
        """Every input by name, at the last poll. Raises DeviceLost."""
        return self._poll().inputs

    async def set_output(self, name: str, value: bool) -> None:
        """Set an output by name, and read it back. See CellIO."""
        address = OUTPUTS.index(name) if name in OUTPUTS else None
        if address is None:
            raise KeyError(name)
        self._poll()
        line = self._connected().line
        if value and name in EXCLUSIVE and await self._output(line, EXCLUSIVE[name]):
            what = f"'{name}' and '{EXCLUSIVE[name]}' must not be set together"
            raise DeviceRefused(self.name, what, f"switch '{EXCLUSIVE[name]}' off first")
        await line.ask(f"set '{name}'", lambda c: c.write_coil(address, value, device_id=line.unit))
        if await self._output(line, name) != value:
            what = f"'{name}' does not keep the value that was written"
            raise DeviceRefused(self.name, what, "does the PLC's program write this output itself?")

    async def temperatures(self) -> Temperatures:
        """Temperatures at the last poll, °C; None: a broken sensor. Raises DeviceLost."""
        poll = self._poll()
        found = poll.readings
        return Temperatures(found.air_c, found.arm_c, found.base_c, found.fixture_c, poll.time_ns)

    async def weather(self) -> Weather:
        """The air at the last poll. Raises DeviceFault (a broken sensor), DeviceLost."""
        air = self._poll().readings
        if air.air_c is None or air.pressure_hpa is None or air.humidity_percent is None:
            raise self._broken_sensors(air)
        return Weather(air.air_c, air.pressure_hpa, air.humidity_percent)

    async def health(self) -> Health:
        """Faults of the PLC and its sensors; figures: latency, age of the poll, counts. Raises DeviceLost."""
        polling, poll = self._connected(), self._poll()
        troubles = [error.what for error in (self._clamp_fault(poll),) if error]
        if poll.readings.broken():
            troubles.append(self._broken_sensors(poll.readings).what)
        if poll.readings.fault_code:
            troubles.append(f"the PLC reports fault {poll.readings.fault_code}")
        figures = {
            "latency_ms": polling.line.latency_s * 1e3,
            "poll_age_ms": polling.age_s() * 1e3,
            "reconnections": float(polling.reconnections),
            "restarts": float(polling.restarts),
            "uptime_s": float(poll.readings.uptime_s),
            "fault_code": float(poll.readings.fault_code),
            "supply_bar": poll.readings.supply_bar,
        }
        return Health(not troubles, "; ".join(troubles) or _state(poll), figures)

    def conditions(self) -> Mapping[str, str]:
        """The conditions that an interlock can name: every input, and two of the driver's own."""
        return _CONDITIONS

    async def holds(self, condition: str) -> bool:
        """Whether a condition holds at the last poll.

        Raises DeviceLost (a stale poll), DeviceFault (the sensors of the clamp contradict each other), KeyError.
        """
        if condition not in _CONDITIONS:
            raise KeyError(condition)
        poll = self._poll()
        if condition == "alive":
            return True
        if condition == "temperatures_ok":
            return not poll.readings.broken()
        if condition in EXCLUSIVE_INPUTS and (fault := self._clamp_fault(poll)):
            raise fault
        return poll.inputs[condition]

    async def stop(self) -> None:
        """Nothing to stop: its outputs stay as they are, and its safety chain does not depend on this computer."""

    async def close(self) -> None:
        """End the poll, and the connection. The PLC's watchdog then finds the heartbeat missing."""
        polling, self._polling = self._polling, None
        if polling:
            await polling.close()

    def _line(self) -> ModbusLine:
        return ModbusLine(self.name, self._place.host, self._place.port, self._place.unit, self._clock)

    def _connected(self) -> Polling:
        if self._polling is None:
            raise DeviceLost(self.name, "is not connected", "connect it first")
        return self._polling

    def _poll(self) -> Poll:
        return self._connected().latest()

    async def _output(self, line: ModbusLine, name: str) -> bool:
        address = OUTPUTS.index(name)
        answer = await line.ask(f"read '{name}' back", lambda c: c.read_coils(address, count=1, device_id=line.unit))
        return bool(answer.bits[0])

    async def _identity(self, line: ModbusLine) -> Identity:
        """Function 43/14, which not every PLC has; without it the place is the identity."""
        try:
            answer = await line.ask("identify", lambda c: c.read_device_information(read_code=1, device_id=line.unit))
        except (DeviceRefused, DeviceFault, DeviceBusy):
            return Identity(self.name, f"{self._place.host}:{self._place.port}", "Modbus PLC", "", simulated=False)
        vendor, product, revision = (_text(answer.information.get(number)) for number in range(3))
        serial = product.split(" ")[0]
        return Identity(self.name, serial, f"{vendor} {product}".strip(), revision, serial.startswith("SIM-"))

    def _broken_sensors(self, found: Readings) -> DeviceFault:
        return DeviceFault(self.name, f"broken sensors: {', '.join(found.broken())}", _SENSOR_CURE)

    def _clamp_fault(self, poll: Poll) -> DeviceError | None:
        clamped, unclamped = poll.inputs["clamped"], poll.inputs["unclamped"]
        if clamped and unclamped:
            return DeviceFault(self.name, "the clamp's sensors show clamped and unclamped at once", _CLAMP_CURE)
        if not clamped and not unclamped and self._connected().clamp_between_s() > CLAMP_TRAVEL_S:
            what = f"the clamp's sensors show neither clamped nor unclamped for more than {CLAMP_TRAVEL_S:g} s"
            return DeviceFault(self.name, what, _CLAMP_CURE)
        return None


EXCLUSIVE_INPUTS = ("clamped", "unclamped")


def _state(poll: Poll) -> str:
    inputs = poll.inputs
    emergency = "closed" if inputs["emergency_stop_ok"] else "OPEN"
    guard = "closed" if inputs["guard_closed"] else "OPEN"
    return f"emergency stop chain {emergency}, guard {guard}"


def _text(value: object) -> str:
    return value.decode("ascii", "replace") if isinstance(value, bytes) else str(value or "")


_WAIT_S = 60.0
"""Longest wait for an input, in the cell's time."""
_LOOK_S = 0.02

_INPUTS = {
    "guard_closed": ("Open the guard door", "open guard"),
    "emergency_stop_ok": ("Press an emergency stop", "press emergency stop"),
}
"""Input that ends → what to do, at the cell and at a simulated one."""

_BACK = "Release the emergency stop, close the guard door, acknowledge every message at the pendant"


def _steps_of(plc: CellReadings, clock: Clock) -> tuple[CommissioningStep, ...]:
    """The step of `plc`, without motion."""
    return (
        CommissioningStep(
            "safety",
            "safety inputs by hand",
            "Somebody opens the guard door and presses an emergency stop; the inputs are read.",
            "a run ends when the safety chain opens",
            partial(_safety, plc, clock),
        ),
    )


async def _safety(plc: CellReadings, clock: Clock, person: Person) -> list[Figure]:
    figures = []
    for name, (text, action) in _INPUTS.items():
        await _until(plc, clock, name, expected=True)
        await person.told(text, plc.name, action)
        await _until(plc, clock, name, expected=False)
        await person.asked(_BACK, plc.name, "reset")
        await _until(plc, clock, name, expected=True)
        figures.append(Figure(name, f"{name} follows", "yes", wanted="yes"))
    return figures


async def _until(plc: CellReadings, clock: Clock, name: str, *, expected: bool) -> None:
    """Wait for a value of an input. Raises DeviceFault if it does not come."""
    try:
        async with clock.timeout(_WAIT_S):
            while (await plc.inputs())[name] is not expected:
                await clock.sleep(_LOOK_S)
    except TimeoutError:
        what = f"the input {name} has not become {int(expected)} within {_WAIT_S:g} s"
        raise DeviceFault(plc.name, what, "check its wire, and the I/O map in the PLC's program") from None
