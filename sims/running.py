"""`python -m sims run`: every device of a cell on its own wire, with a common time, until stopped or orphaned."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import mmap
import os
import shutil
import signal
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any, TextIO, final

from sims.cell import CellError, read_cell
from sims.cell_content import SimCell, Simulate
from sims.control import ControlPort
from sims.faults import Faults
from sims.kernel import Kernel, Mode
from sims.memory import BadMemory, Memory, sole_user
from sims.scene.scene import Scene
from sims.simulator import CannotStart, Setup, Started
from sims.simulators import installed
from sims.wires import Wire


@final
class TimeFile:
    """An 8-byte little-endian integer, nanoseconds, memory-mapped, in a folder of its own that `close` removes."""

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix="cellsim-")) / "time"
        self.path.write_bytes(bytes(8))
        with self.path.open("r+b") as stream:
            self._map = mmap.mmap(stream.fileno(), 8)
        # one store of a machine word: struct.pack_into would write byte by byte, and a reader could see half a time
        self._word = memoryview(self._map).cast("q")

    def publish(self, now_ns: int) -> None:
        """Write the cell's time."""
        self._word[0] = now_ns

    def close(self) -> None:
        """Remove the file. Readers that have it mapped keep its last value."""
        self._word.release()
        self._map.close()
        shutil.rmtree(self.path.parent, ignore_errors=True)


_PR_SET_PDEATHSIG = 1


def end_with_parent(kernel: Kernel, parent: int) -> None:
    """Stop `kernel` once the process `parent` is gone, be it ours or not."""
    if os.getppid() == parent:
        _die_with_parent()
    with suppress(OSError, AttributeError):
        # sees the end even where nobody has collected the process yet
        kernel.watch(os.pidfd_open(parent), kernel.stop)
    kernel.every_half_second(lambda: None if _exists(parent) else kernel.stop())


def _die_with_parent() -> None:
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _exists(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


@final
@dataclass(frozen=True, slots=True)
class Settings:
    """The command line besides the cell: seed and clock override the cell file's. `state`: its memory.

    `wait_for_host`: in lockstep, T stays at 0 until a host attaches.
    """

    seed: int | None = None
    clock: Mode | None = None
    ready: Path | None = None
    parent: int | None = None
    truth_log: Path | None = None
    state: Path | None = None
    wait_for_host: bool = False


@final
class RunningCell:
    """The simulators of a cell, listening. `ready` is what the ready file says."""

    def __init__(
        self,
        cell: SimCell,
        truth_log: TextIO | None = None,
        memory: Memory | None = None,
        *,
        wait_for_host: bool = False,
    ) -> None:
        self._memory = memory or Memory()
        with contextlib.ExitStack() as building:
            control = self._build(cell, truth_log, building)
            if wait_for_host:
                control.wait_for_host()
            self._closing = building.pop_all()

    def run(self) -> None:
        """Until the kernel is stopped; what is to be remembered is, as it is then."""
        self.kernel.run()
        self._memory.save()

    def close(self) -> None:
        """Close all connections and remove the time file."""
        self._closing.close()

    def _build(self, cell: SimCell, truth_log: TextIO | None, closing: contextlib.ExitStack) -> ControlPort:
        lockstep = cell.simulate.clock == "lockstep"
        time_file = TimeFile() if lockstep else None
        if time_file is not None:
            closing.callback(time_file.close)
        self.kernel = Kernel(cell.simulate.clock, time_file and time_file.publish)
        closing.callback(self.kernel.close)
        self.faults = Faults(self.kernel, installed().catalogue(cell.addresses.values()))
        try:
            scene = Scene(self.kernel, cell, self.faults, truth_log=truth_log, memory=self._memory)
        except BadMemory as error:
            raise CellError(cell.path, [str(error)]) from None
        devices, wires = _start_devices(cell, self.kernel, self.faults, scene, self._memory, closing)
        for fault in cell.simulate.faults:
            self.faults.schedule(fault)
        requests = {name: device.requests for name, device in devices.items()}
        control = ControlPort(self.kernel, self.faults, requests, scene.safety, wires)
        closing.callback(control.close)
        self.ready: dict[str, Any] = {
            **{name: device.address for name, device in devices.items()},
            "control": control.address,
            "time": {
                "mode": cell.simulate.clock,
                "source": f"file:{time_file.path}" if time_file else f"wall:{self.kernel.epoch_ns}",
            },
            "seed": cell.simulate.seed,
            "pid": os.getpid(),
        }
        return control


def _start_devices(
    cell: SimCell, kernel: Kernel, faults: Faults, scene: Scene, memory: Memory, closing: contextlib.ExitStack
) -> tuple[dict[str, Started], dict[str, Wire]]:
    """Each device of the cell, started, and its wire."""
    wires = {device: Wire() for device in cell.addresses}
    devices: dict[str, Started] = {}
    for device, address in cell.addresses.items():
        simulator = installed().of(address)
        if simulator is None:  # `read_cell` has refused it
            continue
        setup = Setup(
            device=device,
            address=address,
            settings=cell.simulate.settings.get(simulator.section, {}),
            cell=cell,
            kernel=kernel,
            scene=scene,
            faults=faults,
            wire=wires[device],
            memory=memory,
        )
        try:
            devices[device] = simulator.start(setup)
        except (CannotStart, BadMemory) as error:
            raise CellError(cell.path, [f"{device}: {error}"]) from None
        closing.callback(devices[device].close)
    return devices, wires


def run_cell(path: Path, settings: Settings) -> None:
    """Simulate the cell of a cell file until SIGINT, SIGTERM, `shutdown` or the parent's end. Raises CellError."""
    cell = read_cell(path, to_run=True)
    cell = replace(cell, simulate=_overridden(cell.simulate, settings))
    _on_signals(_leave)
    with contextlib.ExitStack() as closing:
        memory = _memory(cell, settings.state, closing)
        log = closing.enter_context(_open_log(settings.truth_log)) if settings.truth_log else None
        running = RunningCell(cell, log, memory, wait_for_host=settings.wait_for_host)
        closing.callback(running.close)
        _on_signals(lambda *_: running.kernel.stop())
        if settings.parent is not None:
            end_with_parent(running.kernel, settings.parent)
        memory.write()  # a file that cannot be written is better known now
        _tell(json.dumps(running.ready), settings.ready)
        gc.collect()
        gc.freeze()  # what is there now stays to the end: the collector need not look at it
        gc.disable()  # a collection in the middle of a cycle would make it late
        running.kernel.every_half_second(gc.collect)
        running.run()


def _memory(cell: SimCell, state: Path | None, closing: contextlib.ExitStack) -> Memory:
    """Of this cell, and of this process alone: another's is refused. Raises CellError."""
    try:
        closing.enter_context(sole_user(state))
        return Memory(state, {"name": cell.name, "robot": cell.robot.name, "seed": cell.simulate.seed})
    except BadMemory as error:
        raise CellError(cell.path, [str(error)], "the memory does not fit this cell") from None


def _overridden(simulate: Simulate, settings: Settings) -> Simulate:
    seed = simulate.seed if settings.seed is None else settings.seed
    return replace(simulate, seed=seed, clock=settings.clock or simulate.clock)


def _on_signals(handler: Callable[[int, FrameType | None], object]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)


def _leave(*_: object) -> None:
    raise SystemExit(0)


def _open_log(path: Path) -> TextIO:
    return path.open("w", encoding="utf-8", buffering=1)


def _tell(text: str, ready: Path | None) -> None:
    """Write the ready file, so that whoever sees it sees all of it; without one, say it on stdout."""
    if ready is None:
        print(text, flush=True)
        return
    unfinished = ready.with_name(f".{ready.name}.{os.getpid()}")
    unfinished.write_text(text + "\n", encoding="utf-8")
    unfinished.replace(ready)
