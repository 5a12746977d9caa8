"""The devices of a cell: locked, simulated if its file says so, opened and connected; files for its controller.

The lock is the kernel's: it ends with its process, however that ends. Simulated cells need none: each run starts
simulators of its own.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import stat
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator, Collection, Iterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, final
from urllib.parse import quote

from cellctl.clock import Clock, LockstepClock, WallClock
from cellctl.devices import Address, Device, DeviceBusy, DeviceError, DeviceUnreachable, FileStore, Identity, Listener
from cellctl.devices.cell import Cell, ClockMode
from cellctl.devices.registry import DriverRegistry
from cellctl.files import Document, InputError, Problem
from cellctl.files.locked import HAS_LOCKS, LockedByOther, LockedFile, locked_text
from cellctl.journal import Writer
from cellctl.procedure.check import missing_abilities


def require_cells() -> None:
    """Raise InputError on systems other than Linux: drivers and simulators need Linux."""
    if not HAS_LOCKS:
        cure = "do it on Linux; fit, predict, compensate, convert, import, report, runs and show work here"
        raise InputError(Problem("this system", 0, 0, "cannot work with a cell: it has no POSIX terminals", cure))


VARIABLE = "CELLCTL_LOCKS"
"""Environment variable: the folder of the locks. Containers that reach one cell must share it."""

_NO_SERIAL = " 0?-.,:/"
"""A serial number of these characters alone is none: a device that was never given one reports 0 or nothing."""


@final
class DeviceLocks:
    """The locks that this process has on devices of a cell."""

    def __init__(self, cell: Cell, run: str) -> None:
        self._cell, self._run = cell, run
        self._held: dict[str, LockedFile] = {}

    @classmethod
    @contextmanager
    def held(
        cls, cell: Cell, drivers: DriverRegistry, *, names: Collection[str] | None = None, run: str = ""
    ) -> Iterator[Self]:
        """The locks of the devices `names` (None: of all), held inside this context; nothing is connected.

        run: name of the run that they are for, empty: a command. Raises DeviceBusy, with the run that has them.
        """
        locks = cls(cell, run)
        try:
            for place, device in sorted(_places(cell, drivers, names).items()):  # in one order, so that one of two wins
                locks._take(place, device)
            yield locks
        finally:
            for held in locks._held.values():
                held.release()

    def meet(self, identity: Identity) -> None:
        """Lock the serial number that a connected device reports: two addresses can lead to one device.

        Raises DeviceBusy if another process has this device by another address.
        """
        known = bool(identity.serial.strip(_NO_SERIAL))
        if known and not identity.simulated and not self._cell.simulated:
            maker = self._cell.addresses[identity.device].scheme.partition("+")[0]
            self._take(f"serial {maker} {identity.serial}", identity.device)

    def _take(self, place: str, device: str) -> None:
        """Lock a place; devices of this cell may share it."""
        if place in self._held:
            return
        text = Writer.this_process().text() + f"{self._run}\n"
        try:
            self._held[place] = LockedFile.take(_file(place), text, every_user=True)
        except LockedByOther as other:
            raise _busy(device, other.text) from None


def refuse_in_use(cell: Cell, drivers: DriverRegistry) -> None:
    """Raise DeviceBusy if another process has a device of this cell now."""
    for place, device in sorted(_places(cell, drivers, None).items()):
        if (text := locked_text(_file(place))) is not None:
            raise _busy(device, text)


def _places(cell: Cell, drivers: DriverRegistry, names: Collection[str] | None) -> dict[str, str]:
    """Place → device of a real cell."""
    listed = {} if cell.simulated else cell.addresses
    chosen = {name: address for name, address in listed.items() if names is None or name in names}
    return {place: name for name, address in chosen.items() for place in drivers.places(address)}


def _busy(device: str, text: str) -> DeviceBusy:
    writer, run = Writer.read(text), "".join(text.split("\n")[4:5])
    by = f"run {run} (process {writer.pid}, since {writer.since})" if run else f"process {writer.pid}: {writer.command}"
    end = f"`cellctl abort {run}`" if run else f"kill {writer.pid}"
    return DeviceBusy(device, f"is in use by {by}", f"wait for its end, or end it ({end}); then try again")


def _file(place: str) -> Path:
    """The lock file of a place. Raises OSError if the folder cannot be made."""
    folder = _folder()
    if not folder.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o1777)  # as /tmp: every user makes files, nobody removes those of others
    return folder / quote(place, safe=" :,")


def _folder() -> Path:
    """One folder for all users of this computer: the choice must not depend on who asks, nor on TMPDIR."""
    if stated := os.environ.get(VARIABLE):
        return Path(stated)
    usual = Path("/run/lock")
    for_all = usual.is_dir() and bool(usual.stat().st_mode & stat.S_IWOTH)
    return (usual if for_all else Path("/tmp")) / "cellctl"


_START_SECONDS = 60.0
_END_SECONDS = 20.0
_ANSWER_SECONDS = 20.0
"""Wall time limit for a program to start and end. If it dies, the wait ends at once."""

_END_NOTICED_SECONDS = 0.3
"""Wall time in which simulators that have hung up are gone."""

_ERRORS = "stderr"
"""File of what the simulators write, beside their ready file."""


@final
@dataclass(frozen=True)
class SimulatedCell:
    """A running simulator process and the content of its ready file.

    `state`: the folder of what its drivers keep beyond their lives, beside the simulators' memory if they have one.
    """

    process: subprocess.Popen[bytes]
    folder: tempfile.TemporaryDirectory[str]
    ready: dict[str, Any]
    state: Path | None = None

    @classmethod
    async def start(cls, cell: Cell, seed: int | None, clock: ClockMode | None, extra: tuple[str, ...] = ()) -> Self:
        """Start the simulators of `cell` and wait until they listen.

        Raises InputError if the simulators refuse the cell file, DeviceUnreachable if they do not start.
        """
        folder = tempfile.TemporaryDirectory(prefix="cellctl-")
        ready = Path(folder.name) / "ready.json"
        command = simulator_command(cell.path, seed, clock, ready, ("--wait-for-host", *extra))
        with (Path(folder.name) / _ERRORS).open("wb") as errors:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=errors, stderr=errors, start_new_session=True
            )
        try:
            await _until_ready(process, ready)
        except BaseException:
            process.kill()
            process.wait()
            _explain(process, Path(folder.name) / _ERRORS, cell)
            folder.cleanup()
            raise
        memory = Path(extra[extra.index("--state") + 1]).parent if "--state" in extra else Path(folder.name)
        return cls(process, folder, json.loads(ready.read_text()), memory / "drivers")

    def address(self, device: str) -> Address:
        """The address of `device`."""
        return Address.parse(self.ready[device])

    async def clock(self) -> Clock:
        """The cell's clock; in lockstep its time waits for this loop from now on."""
        kind, _, value = str(self.ready["time"]["source"]).partition(":")
        if kind == "wall":
            return WallClock(int(value))
        host, port = self._control()
        clock = await LockstepClock.attach(value, host, port)
        await clock.sleep(0.0)  # until the first tick: the simulators count what is written to them from there
        return clock

    async def tell(self, message: dict[str, Any]) -> dict[str, Any]:
        """Send a request to the control port. Raises DeviceError if the simulator refuses it or has ended."""
        try:
            reader, writer = await asyncio.open_connection(*self._control())
            writer.write(json.dumps(message).encode() + b"\n")
            answer: dict[str, Any] = json.loads(await asyncio.wait_for(reader.readline(), _ANSWER_SECONDS))
            writer.close()
        except (OSError, ValueError, TimeoutError) as error:
            raise DeviceError("simulator", f"no answer on the control port: {error}") from error
        if not answer.get("ok"):
            raise DeviceError("simulator", f"refused {message['op']}: {answer.get('error')}")
        return answer

    async def reset(self) -> None:
        """Somebody releases its emergency stop, closes its guard, acknowledges its messages. Raises DeviceError."""
        await self.tell({"op": "reset"})

    def why_ended(self) -> str:
        """That the simulators have ended by themselves, and by which error; empty: they run."""
        try:  # a device is lost before its process is gone
            code = self.process.wait(_END_NOTICED_SECONDS)
        except subprocess.TimeoutExpired:
            return ""
        by = f"by signal {-code}" if code < 0 else f"with code {code}"
        text = self.errors()
        *_, last = text.splitlines() or [""]
        places = re.findall(r'File "(?:[^"]*/)?([^"/]+)", line (\d+)', text)
        where = " ({}:{})".format(*places[-1]) if places else ""
        return f"the simulated cell ended {by}" + (f": {last.strip()}{where}" if last else "")

    def errors(self) -> str:
        """What the simulators wrote: the traceback of an error."""
        file = Path(self.folder.name) / _ERRORS
        return file.read_text(errors="replace").strip() if file.exists() else ""  # `stop` removes it

    def stop(self) -> None:
        """End the process and wait for it."""
        self.process.terminate()
        try:
            self.process.wait(_END_SECONDS)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.folder.cleanup()

    def _control(self) -> tuple[str, int]:
        host, _, port = str(self.ready["control"]).rpartition(":")
        return host, int(port)


def simulator_command(
    cell: Path, seed: int | None, clock: ClockMode | None, ready: Path | None, extra: tuple[str, ...] = ()
) -> list[str]:
    """The command that runs the simulators of the cell file `cell`; they end with this process."""
    command = [sys.executable, "-P", "-m", "sims", "run", str(cell), "--parent", str(os.getpid()), *extra]
    if ready:
        command += ["--ready", str(ready)]
    if seed is not None:
        command += ["--seed", str(seed)]
    if clock is not None:
        command += ["--clock", clock]
    return command


def simulation_errors(document: Document, path: Path) -> list[Problem]:
    """The simulators' errors in a cell file, each with its place. Starts no simulation."""
    command = [sys.executable, "-P", "-m", "sims", "check", str(path)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 2) or not done.stdout:
        raise DeviceUnreachable("simulator", f"cannot check {path}:\n{done.stderr.strip()}")
    return [_placed(document, text) for text in json.loads(done.stdout)]


def _placed(document: Document, text: str) -> Problem:
    """`simulate.faults[0]: …` as a problem at that value of the document."""
    where, _, what = text.partition(": ")
    parts = re.findall(r"[A-Za-z_]\w*|\d+", where) if re.fullmatch(r"[\w.\[\]]+", where) else []
    place = tuple(int(part) if part.isdigit() else part for part in parts)
    return document.problem(place, text if not place else f"{where}: {what}", key=True)


async def _until_ready(process: subprocess.Popen[bytes], ready: Path) -> None:
    try:
        async with asyncio.timeout(_START_SECONDS):
            while not ready.exists():
                if process.poll() is not None:
                    raise DeviceUnreachable("simulator", f"ended at its start with code {process.returncode}")
                await asyncio.sleep(0.01)
    except TimeoutError:
        raise DeviceUnreachable("simulator", f"was not ready within {_START_SECONDS:g} s") from None


def _explain(process: subprocess.Popen[bytes], errors: Path, cell: Cell) -> None:
    text = errors.read_text(errors="replace").strip()
    if process.returncode == 2 and text:
        raise InputError(Problem(str(cell.path), 0, 0, f"the simulators refuse this cell:\n{text}"))
    if text:
        raise DeviceUnreachable("simulator", f"did not start:\n{text}")


@final
@dataclass(frozen=True, slots=True)
class Connected:
    """A connected device and its reported identity."""

    device: Any
    identity: Identity


def open_devices(
    cell: Cell,
    drivers: DriverRegistry,
    clock: Clock,
    simulated: SimulatedCell | None,
    names: Collection[str] | None = None,
) -> dict[str, Device]:
    """The cell's devices (those in `names`), not connected: at the file's addresses, or at the simulators'."""
    state = simulated.state if simulated else None
    return {
        name: drivers.open(
            name, simulated.address(name) if simulated else address, cell.surroundings(name, clock, state)
        )
        for name, address in cell.addresses.items()
        if names is None or name in names
    }


async def tell_targets(simulated: SimulatedCell | None, devices: dict[str, Device], clock: Clock) -> None:
    """Send a simulated cell the address of each listening driver; a real controller's configuration has it."""
    if simulated is None:
        return
    for name, device in devices.items():
        if isinstance(device, Listener):
            host, port = device.listening()
            with clock.standing():
                await simulated.tell({"op": "rsi_target", "device": name, "host": host, "port": port})


@asynccontextmanager
async def powered(
    cell: Cell, *, seed: int | None = None, clock: ClockMode | None = None, extra: tuple[str, ...] = ()
) -> AsyncIterator[tuple[SimulatedCell | None, Clock]]:
    """The simulators of a simulated cell inside this context (None: a real cell), and the cell's time.

    Raises InputError if the simulators refuse the cell file, DeviceUnreachable if they do not start.
    """
    async with AsyncExitStack() as stack:
        simulated = await SimulatedCell.start(cell, seed, clock, extra) if cell.simulated else None
        if simulated:
            stack.callback(simulated.stop)
        time = await simulated.clock() if simulated else WallClock()
        stack.push_async_callback(time.aclose)
        yield simulated, time


@asynccontextmanager
async def connected(
    cell: Cell,
    drivers: DriverRegistry,
    names: Collection[str],
    *,
    seed: int | None = None,
    clock: ClockMode | None = None,
    extra: tuple[str, ...] = (),
) -> AsyncIterator[dict[str, Connected]]:
    """The devices `names` of a cell, connected inside this context, closed at its end.

    seed, clock, extra: for the simulators of a simulated cell, which run as long. Raises InputError, DeviceError;
    DeviceBusy, before anything connects, if another process has one of them.
    """
    async with AsyncExitStack() as stack:
        locks = stack.enter_context(DeviceLocks.held(cell, drivers, names=names))
        simulated, time = await stack.enter_async_context(powered(cell, seed=seed, clock=clock, extra=extra))
        devices = open_devices(cell, drivers, time, simulated, names)
        found = {}
        for name, device in devices.items():
            stack.push_async_callback(device.close)
            found[name] = Connected(device, await device.connect())
            locks.meet(found[name].identity)
        await tell_targets(simulated, devices, time)
        yield found


INSTRUCTIONS = "README.txt"
"""Of a controller's files, what a person reads before they are loaded."""


def as_loaded(name: str, text: str) -> bytes:
    """A generated file with the line ends of Windows, which a KRC needs; a file of URScript with those of Linux."""
    return (text if name.endswith(".script") else text.replace("\n", "\r\n")).encode()


def require_files(cell: Cell, drivers: DriverRegistry, device: str) -> None:
    """Raises InputError if this device of the cell cannot write files to its controller; opens nothing."""
    scheme = cell.addresses[device].scheme
    if missing_abilities(drivers.abilities(scheme), FileStore):
        what = f"{device}: a driver for {scheme} cannot write files to its controller"
        raise InputError(cell.document.problem(("devices", device), what, "load them by hand, as README.txt states"))


async def send_files(
    cell: Cell, drivers: DriverRegistry, device: str, folder: str, files: Mapping[str, str]
) -> list[str]:
    r"""Write the files (name → text) but the instructions to `folder` (`KRC:\R1\PROGRAM`); their paths there.

    Each is read back and compared. Raises DeviceError: the files before it are written, the others are not.
    """
    require_cells()
    sent = []
    async with connected(cell, drivers, [device]) as devices:
        for name, text in files.items():
            if name != INSTRUCTIONS:
                path = folder.rstrip("/\\") + "\\" + name
                await devices[device].device.write_file(path, as_loaded(name, text))
                sent.append(path)
    return sent
