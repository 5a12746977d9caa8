"""The robot behind a variable proxy: identity, joints, moves, tables, variables and files of its controller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Final, final

from cellctl.clock import Clock
from cellctl.devices import (
    TABLE_CORRECTION_DEG,
    ControllerTable,
    DeviceError,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    Health,
    Identity,
    JointReadings,
    LimitExceeded,
    TableState,
    lost_before_activation,
    refuse_correction,
    refuse_corrections,
)
from drivers.kuka_varproxy.line import ProxyLine, ProxyPlace
from drivers.kuka_varproxy.moving import ACTUAL, Job, Mover
from drivers.kuka_varproxy.readiness import SLOWEST_PERCENT, AxisRanges, MoveLimits, health_of, require_version
from drivers.kuka_varproxy.tables import TableMemory
from drivers.kuka_varproxy.variables import AXES, SILENCE, SILENCE_STOPPED, STOP, ControllerFiles, Variables
from drivers.seen_through import see_through

_CONDITIONS: Final = {"ready": "the controller reports all that a move needs"}


@final
class VarProxyRobot:
    """A KUKA robot by its variables: a TableRobot, VariableStore and FileStore.

    The proxy has no flow control, verifies nothing, is not in real time and notices no lost connection. So a job has a
    number and a check, the controller's program stops when this computer is silent, and all that counts is read back.
    """

    def __init__(
        self,
        name: str,
        place: ProxyPlace,
        clock: Clock,
        limits: MoveLimits,
        table_correction_deg: float = TABLE_CORRECTION_DEG,
    ) -> None:
        self.name = name
        self._clock = clock
        self._limits = limits
        self._table_correction_deg = table_correction_deg
        self._place = (place.host, place.port)
        self._identity: Identity | None = None
        self._line = ProxyLine(name, self._place, clock)
        self._variables = Variables(name, self._line)
        self._mover = Mover(name, clock, self._variables)
        self._busy = False

    @property
    def axes(self) -> int:
        """Six."""
        return AXES

    async def connect(self) -> Identity:
        """Connect and read the identity; nothing moves. Raises DeviceUnreachable, DeviceRefused, DeviceLost."""
        if self._identity:
            return self._identity
        self._line = ProxyLine(self.name, self._place, self._clock)
        self._variables = Variables(self.name, self._line)
        self._mover = Mover(self.name, self._clock, self._variables)
        try:
            await self._line.open()
            self._identity = await self._read_identity()
        except BaseException:
            await see_through(self._line.close())
            raise
        return self._identity

    async def close(self) -> None:
        """Stop the robot and close the line."""
        with suppress(DeviceError):
            await self.stop()
        self._identity = None
        await see_through(self._line.close())

    async def health(self) -> Health:
        """What the controller reports of itself. Raises DeviceFault, DeviceLost."""
        return await health_of(self.name, self._variables, self._line)

    def conditions(self) -> Mapping[str, str]:
        """The conditions that an interlock can name."""
        return _CONDITIONS

    async def holds(self, condition: str) -> bool:
        """Whether a condition holds. Raises DeviceFault, DeviceLost, KeyError."""
        if condition not in _CONDITIONS:
            raise KeyError(condition)
        return (await self.health()).ok

    # motion

    async def joints(self) -> JointReadings:
        """Measured joints now, degrees. Raises DeviceFault, DeviceLost."""
        return await self._variables.joints(ACTUAL)

    async def move(self, target: JointReadings, speed_percent: float) -> JointReadings:
        """Point to point, planned by the controller; returns the actual joints on arrival, degrees."""
        percent = self._percent(speed_percent)
        with self._one_at_a_time():
            return await self._go(Job(tuple(target), percent))

    async def move_to_row(self, row: int, speed_percent: float) -> JointReadings:
        """Point to point to row `row` (from 1) of the active table; returns the actual joints on arrival, degrees."""
        percent = self._percent(speed_percent)
        with self._one_at_a_time():
            found = await self._tables().active_row(row)
            refuse_correction(self.name, f"row {row} of the table in force", found, self._table_correction_deg)
            return await self._go(Job(found.compensated, percent, row))

    async def stop(self) -> None:
        """Hold the robot in any state. Raises DeviceUncertain if the controller does not confirm it."""
        if not await see_through(self._mover.halt()):
            raise DeviceUncertain(
                self.name,
                "the controller has not confirmed that the robot stands: it may still be moving",
                "Keep away from it, stop it at the pendant, then look at the line.",
            )

    # compensation tables

    async def push_table(self, table: ControllerTable) -> TableState:
        """Stage, read every row back, compare, activate at once; see TableStore."""
        with self._one_at_a_time():
            with lost_before_activation(self.name, table):
                await require_version(self.name, self._variables)
                ranges = await AxisRanges.read(self._variables)
            for row in table.rows:
                ranges.check(self.name, row.compensated)
            refuse_corrections(self.name, table, self._table_correction_deg)
            return await self._tables().push(table)

    async def table_state(self) -> TableState:
        """The controller's tables; see TableStore."""
        return await self._tables().state()

    async def read_table(self) -> ControllerTable | None:
        """The active table as stored on the controller; see TableStore."""
        with self._one_at_a_time():
            return await self._tables().read()

    async def rollback_table(self) -> TableState:
        """Activate the previous table again; see TableStore."""
        with self._one_at_a_time():
            return await self._tables().rollback()

    # variables and files

    async def read_variable(self, name: str) -> str:
        """The value of a variable as KRL writes it; see VariableStore."""
        return await self._variables.read(name)

    async def write_variable(self, name: str, value: str) -> None:
        """Write a variable, read it back and compare; see VariableStore. Variables of moves and tables are refused."""
        plain = "".join(name.split()).upper()
        if plain.startswith("KV_") or plain in (STOP, SILENCE, SILENCE_STOPPED):
            raise DeviceRefused(
                self.name, f"{name} belongs to moves and tables", "Use move, stop and the table commands."
            )
        await self._variables.write_verified(name, value)

    async def read_file(self, path: str) -> bytes:
        """The content of a controller's file; see FileStore. Needs a C3 Bridge."""
        with self._one_at_a_time():
            return await ControllerFiles(self.name, self._line).read(path)

    async def write_file(self, path: str, content: bytes) -> None:
        """Write a controller's file, read it back and compare; see FileStore. Needs a C3 Bridge."""
        with self._one_at_a_time():
            await ControllerFiles(self.name, self._line).write(path, content)

    # internal

    async def _go(self, job: Job) -> JointReadings:
        await require_version(self.name, self._variables)
        (await AxisRanges.read(self._variables)).check(self.name, job.joints)
        return await self._mover.run(job)

    async def _read_identity(self) -> Identity:
        serial = await self._variables.text("$KR_SERIALNO")
        model = await self._variables.text("$MODEL_NAME[]")
        version = await self._variables.text("$V_R1MADA[]")
        try:
            proxy = await self._variables.text("@PROXY_TYPE")
        except DeviceRefused:  # a variable of the C3 Bridge's own
            proxy = "KUKAVARPROXY"
        return Identity(self.name, serial, model, f"KSS {version}, {proxy}", serial.startswith("SIM-"))

    def _tables(self) -> TableMemory:
        if self._identity is None:
            raise DeviceLost(self.name, "not connected")
        return TableMemory(self.name, self._variables, self._identity.serial)

    def _percent(self, speed_percent: float) -> int:
        """Whole percent, never faster than asked. Raises LimitExceeded."""
        highest = self._limits.speed_percent
        if not SLOWEST_PERCENT <= speed_percent <= highest:
            what = f"move: speed {speed_percent:g} % is not within {SLOWEST_PERCENT:g} … {highest:g} %"
            raise LimitExceeded(self.name, what, "The upper limit is speed_percent in the cell file.")
        return int(speed_percent)

    @contextmanager
    def _one_at_a_time(self) -> Iterator[None]:
        if self._busy:
            raise DeviceRefused(self.name, "another command is under way")
        self._busy = True
        try:
            yield
        finally:
            self._busy = False
