"""The PLC: its program (inputs, outputs, watchdog over the computer) and its TCP end, which answers after a delay."""

from __future__ import annotations

import random
from collections.abc import Sequence
from functools import partial
from typing import Any, final

from sims.faults import Faults
from sims.kernel import Event, Kernel
from sims.plc._modbus import (
    HEARTBEAT,
    ILLEGAL_VALUE,
    NO_TARGET,
    Frame,
    FrameStream,
    ModbusException,
    answer,
    exception,
    low_first,
    unit_of,
)
from sims.scene.scene import Scene
from sims.simulator import Refused, Request, Setup, with_settings
from sims.wires import Client, TcpServer

SCAN_NS = 100_000_000
"""Its counter goes up once in this time."""

BROKEN = 0x8000
CLAMP, UNCLAMP, LOCK = 1, 2, 0
COILS = 9
PC_HEARTBEAT, WATCHDOG_MS = 0, 3
SUPPLY_CENTIBAR = 600
HEARTBEAT_LOST, CLAMP_FAULT, SENSOR_FAULT = 1, 2, 3

_SENSORS = 6


@final
class Clamp:
    """The tool's clamp: its coils drive it to one end, and its two sensors show the ends. It begins clamped."""

    def __init__(self, kernel: Kernel, takes_ns: int) -> None:
        self._kernel = kernel
        self._takes_ns = takes_ns
        self._to = CLAMP
        self._there_ns = 0

    def drive(self, end: int) -> None:
        """Go to an end, CLAMP or UNCLAMP."""
        if end != self._to:
            self._to, self._there_ns = end, self._kernel.now + self._takes_ns

    def sensors(self) -> tuple[bool, bool]:
        """Clamped, unclamped; neither on the way."""
        there = self._kernel.now >= self._there_ns
        return there and self._to == CLAMP, there and self._to == UNCLAMP


@final
class PlcProgram:
    """The memory that a Modbus client sees: the `Tables` of `sims.plc._modbus`.

    Once the computer has written its heartbeat, the register must change within the watchdog's time (holding register
    3, ms; 0: off). If it does not, the PLC drops its motion enable to the robot, until the heartbeat is back.
    """

    def __init__(
        self, kernel: Kernel, scene: Scene, faults: Faults, seed: int, clamp_ns: int, *, low_first: bool
    ) -> None:
        draw = random.Random(f"{seed} plc")
        self._kernel, self._scene, self._faults = kernel, scene, faults
        self._serial = f"SIM-{draw.randrange(10**6):06d}"
        self._on_before_s = draw.randrange(100, 10_000_000)
        self._low_first = low_first
        self._clamp = Clamp(kernel, clamp_ns)
        self._coils = [False] * COILS
        self._holding = [0, 0, 0, 1000]
        self._watchdog: Event | None = None
        self._frozen: tuple[Sequence[bool], Sequence[int]] | None = None
        faults.on_start("plc.stale", self._freeze)
        faults.on_end("plc.stale", self._thaw)

    def discrete_inputs(self) -> Sequence[bool]:
        """Inputs 0 to 13 of the I/O map."""
        return self._frozen[0] if self._frozen else self._inputs()

    def input_registers(self) -> Sequence[int]:
        """Registers 0 to 10 of the I/O map."""
        return self._frozen[1] if self._frozen else self._registers()

    def coils(self) -> Sequence[bool]:
        """Outputs 0 to 8 of the I/O map."""
        return self._coils

    def holding_registers(self) -> Sequence[int]:
        """PC heartbeat, mode, recipe, watchdog time."""
        return self._holding

    def identification(self) -> Sequence[str]:
        """Vendor, product code with serial, revision."""
        return "cellctl", f"{self._serial} cell PLC", "1.0"

    def write_coils(self, first: int, values: Sequence[bool]) -> None:
        """Set outputs. Raises ModbusException if clamp and unclamp would both be set."""
        coils = [*self._coils[:first], *values, *self._coils[first + len(values) :]]
        if coils[CLAMP] and coils[UNCLAMP]:
            raise ModbusException(ILLEGAL_VALUE)
        self._coils = coils
        for end in (CLAMP, UNCLAMP):
            if coils[end]:
                self._clamp.drive(end)

    def write_registers(self, first: int, values: Sequence[int]) -> None:
        """Set registers. Raises ModbusException for a watchdog time between 1 and 99 ms or above 10 s."""
        holding = [*self._holding[:first], *values, *self._holding[first + len(values) :]]
        if holding[WATCHDOG_MS] != 0 and not 100 <= holding[WATCHDOG_MS] <= 10_000:
            raise ModbusException(ILLEGAL_VALUE)
        beaten = holding[PC_HEARTBEAT] != self._holding[PC_HEARTBEAT]
        self._holding = holding
        if beaten:
            self._faults.announce(HEARTBEAT)
            self._scene.safety.enable_motion(True)
        if beaten or first <= WATCHDOG_MS < first + len(values):
            self._watch()

    def _watch(self) -> None:
        """Start the watchdog's time anew, once there is a heartbeat to watch."""
        if self._watchdog:
            self._watchdog.cancel()
        if self._holding[WATCHDOG_MS] and self._faults.counts[HEARTBEAT]:
            due_ns = self._holding[WATCHDOG_MS] * 1_000_000
            self._watchdog = self._kernel.after(due_ns, lambda: self._scene.safety.enable_motion(False))

    def _inputs(self) -> Sequence[bool]:
        safety = self._scene.safety
        stuck = self._faults.active("plc.clamp") is not None
        clamped, unclamped = (True, True) if stuck else self._clamp.sensors()
        locked = self._coils[LOCK] and safety.guard_closed
        return (
            safety.emergency_stop_ok,
            safety.guard_closed,
            locked,
            not safety.ok,  # safety reset required
            True,  # air pressure
            clamped,
            unclamped,
            True,  # tool present
            safety.ok and safety.motion_enabled,  # drives on
            True,  # AUTO
            True,  # torch cleaner home
            True,  # sphere cover open
            True,  # tracker power
            False,  # maintenance switch
        )

    def _registers(self) -> Sequence[int]:
        uptime = self._on_before_s + self._kernel.now // 1_000_000_000
        words = (uptime >> 16 & 0xFFFF, uptime & 0xFFFF)
        counter = self._kernel.now // SCAN_NS & 0xFFFF
        measured = self._measured()
        return (*measured, SUPPLY_CENTIBAR, counter, *(words[::-1] if self._low_first else words), self._fault_code())

    def _measured(self) -> list[int]:
        air = self._scene.environment()
        values = (air.air_c, air.base_c, air.arm_c, air.fixture_c, air.pressure_hpa, air.humidity_percent)
        shown = [round(10.0 * value) & 0xFFFF for value in values]
        fault = self._faults.active("plc.sensor")
        if fault:
            shown[min(fault.settings["sensor"], _SENSORS) - 1] = BROKEN
        return shown

    def _fault_code(self) -> int:
        if not self._scene.safety.motion_enabled:
            return HEARTBEAT_LOST
        if self._faults.active("plc.clamp"):
            return CLAMP_FAULT
        return SENSOR_FAULT if self._faults.active("plc.sensor") else 0

    def _freeze(self) -> None:
        self._frozen = self._inputs(), self._registers()

    def _thaw(self) -> None:
        self._frozen = None


@final
class Talk:
    """What one client asks: its requests are done one after another, each after its own delay."""

    def __init__(self, kernel: Kernel, client: Client, server: PlcServer) -> None:
        self._kernel, self._client, self._server = kernel, client, server
        self._stream = FrameStream()
        self._free_ns = 0

    def feed(self, data: bytes) -> bool:
        """Take the requests in `data`; False where they are no Modbus."""
        for frame in self._stream.feed(data):
            self._free_ns = max(self._free_ns, self._kernel.now) + self._server.delay_ns()
            self._kernel.at(self._free_ns, partial(self._do, frame))
        return not self._stream.broken

    def _do(self, request: Frame) -> None:
        if self._client.open:
            self._client.send(Frame(request.transaction, request.unit, self._server.answer(request)).encode())


@final
class PlcServer:
    """Answers Modbus requests on a free port of 127.0.0.1.

    Fault `plc.gone`: every connection is closed, and a new one finds nobody who answers.
    """

    def __init__(self, setup: Setup) -> None:
        settings, seed = setup.settings, setup.cell.simulate.seed
        self._unit = unit_of(setup.address)
        self._least_ns = round(settings["delay_least_ms"] * 1e6)
        self._most_ns = max(self._least_ns, round(settings["delay_most_ms"] * 1e6))
        self._draw = random.Random(f"{seed} plc delays")
        clamp_ns = round(settings["clamp_ms"] * 1e6)
        words = low_first(setup.address)
        self.program = PlcProgram(setup.kernel, setup.scene, setup.faults, seed, clamp_ns, low_first=words)
        self._end = TcpServer(setup.kernel, setup.wire, lambda client: Talk(setup.kernel, client, self))
        self.port = self._end.port
        self.address = with_settings(setup.address, f"127.0.0.1:{self.port}")
        self.requests: dict[str, Request] = {"by_hand": self._by_hand}
        self._safety = setup.scene.safety
        setup.faults.on_start("plc.gone", self._end.hang_up)
        setup.faults.on_end("plc.gone", self._end.listen)

    def delay_ns(self) -> int:
        """Time from a request to its answer."""
        return self._draw.randint(self._least_ns, self._most_ns)

    def answer(self, request: Frame) -> bytes:
        """The answer's PDU. A unit that is not there is answered as by a gateway: 0B."""
        if request.unit != self._unit:
            return exception(request.pdu, NO_TARGET)
        return answer(request.pdu, self.program)

    def _by_hand(self, message: dict[str, Any]) -> None:
        """Somebody opens the guard, or presses the emergency stop; `reset` puts it back. Raises Refused."""
        actions = {
            "open guard": self._safety.open_guard,
            "press emergency stop": self._safety.open_emergency_stop,
        }
        act = actions.get(str(message.get("action")))
        if act is None:
            raise Refused(f"by hand there are {', '.join(actions)}")
        act()

    def close(self) -> None:
        """Hang up on every client, and stop listening."""
        self._end.close()
