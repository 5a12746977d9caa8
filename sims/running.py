"""`python -m sims run`: every device of a cell on its own wire, one time for all, until somebody ends it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any, TextIO, final
from urllib.parse import parse_qsl, urlencode, urlsplit

from sims import parent
from sims.cell import CellError, SimCell, Simulate, read_cell
from sims.control import ControlPort, RsiTarget
from sims.faults import Faults
from sims.kernel import Kernel, Mode
from sims.memory import BadMemory, Memory, sole_user
from sims.scene.contact_loop import ContactLoop
from sims.timefile import TimeFile
from sims.wires import Wire

ROBOT = "kuka+rsi"
PROBE = "contact+serial"


@final
@dataclass(frozen=True, slots=True)
class Settings:
    """What the command line says besides the cell: seed and clock win over the cell file's. `state`: its memory.

    `wait_for_host`: in lockstep, T stands at 0 until a host attaches.
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
        """Hang up on everybody and remove the time file."""
        self._closing.close()

    def _build(self, cell: SimCell, truth_log: TextIO | None, closing: contextlib.ExitStack) -> ControlPort:
        lockstep = cell.simulate.clock == "lockstep"
        time_file = TimeFile() if lockstep else None
        if time_file is not None:
            closing.callback(time_file.close)
        self.kernel = Kernel(cell.simulate.clock, time_file and time_file.publish)
        closing.callback(self.kernel.close)
        self.faults = Faults(self.kernel)
        wires = {device: Wire() for device in cell.addresses}
        devices, rsi_targets = _start_devices(cell, self.kernel, self.faults, truth_log, self._memory, wires, closing)
        for setting in cell.simulate.faults:
            self.faults.schedule(setting)
        control = ControlPort(self.kernel, self.faults, rsi_targets, wires)
        closing.callback(control.close)
        self.ready: dict[str, Any] = {
            **devices,
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
    cell: SimCell,
    kernel: Kernel,
    faults: Faults,
    truth_log: TextIO | None,
    memory: Memory,
    wires: dict[str, Wire],
    closing: contextlib.ExitStack,
) -> tuple[dict[str, str], dict[str, RsiTarget]]:
    """Device → address with the places filled in, and the robots' RSI targets."""
    loop = ContactLoop()
    addresses: dict[str, str] = {}
    rsi_targets: dict[str, RsiTarget] = {}
    for device, address in cell.addresses.items():
        if urlsplit(address).scheme == ROBOT:
            from sims import krc  # numpy and the world, which a cell without a robot does without

            try:
                robot = krc.start(kernel, cell, faults, loop, truth_log, memory=memory, wire=wires[device])
            except (krc.BadConfig, BadMemory) as error:
                raise CellError(cell.path, [f"{device}: {error}"]) from None
            closing.callback(robot.close)
            rsi_targets[device] = robot.set_rsi_target
            places = {"eki": f"127.0.0.1:{robot.eki_port}"}
            if "controller" in dict(parse_qsl(urlsplit(address).query)):
                places["controller"] = "127.0.0.1"
            addresses[device] = with_settings(address, "127.0.0.1:0", **places)
        else:
            from sims import probe

            server = probe.start(kernel, cell, faults, loop, _baud(address), wires[device])
            closing.callback(server.close)
            addresses[device] = with_path(address, server.path)
    return addresses, rsi_targets


def with_settings(address: str, place: str, **settings: str) -> str:
    """The address with this host and port, and settings added or replaced."""
    parts = urlsplit(address)
    query = {**dict(parse_qsl(parts.query)), **settings}
    return f"{parts.scheme}://{place}{parts.path}?{urlencode(query, safe='/:')}"


def with_path(address: str, path: str) -> str:
    """The address with this path and no host."""
    parts = urlsplit(address)
    return f"{parts.scheme}://{path}" + (f"?{parts.query}" if parts.query else "")


def _baud(address: str) -> int:
    return int(dict(parse_qsl(urlsplit(address).query)).get("baud", "250000"))


def check_devices(cell: SimCell) -> None:
    """Raises CellError where a device of the cell cannot be simulated."""
    problems = []
    schemes = [urlsplit(address).scheme for address in cell.addresses.values()]
    for device, scheme in zip(cell.addresses, schemes, strict=True):
        if scheme not in {ROBOT, PROBE}:
            problems.append(f"{device}: there is no simulator for '{scheme}', only for {ROBOT} and {PROBE}")
    problems += [f"only one device of {kind} can be simulated" for kind in (ROBOT, PROBE) if schemes.count(kind) > 1]
    for device, address in cell.addresses.items():
        with contextlib.suppress(ValueError):
            if _baud(address) > 0:
                continue
        problems.append(f"{device}: baud is not a number above 0")
    if problems:
        raise CellError(cell.path, problems)


def run_cell(path: Path, settings: Settings) -> None:
    """Simulate the cell of a cell file until SIGINT, SIGTERM, `shutdown` or the parent's end. Raises CellError."""
    cell = read_cell(path)
    check_devices(cell)
    cell = replace(cell, simulate=_overridden(cell.simulate, settings))
    _on_signals(_leave)
    with contextlib.ExitStack() as closing:
        memory = _memory(cell, settings.state, closing)
        log = closing.enter_context(_open_log(settings.truth_log)) if settings.truth_log else None
        running = RunningCell(cell, log, memory, wait_for_host=settings.wait_for_host)
        closing.callback(running.close)
        _on_signals(lambda *_: running.kernel.stop())
        if settings.parent is not None:
            parent.end_with(running.kernel, settings.parent)
        memory.write()  # a file that cannot be written is better known now
        _tell(json.dumps(running.ready), settings.ready)
        running.run()


def _memory(cell: SimCell, state: Path | None, closing: contextlib.ExitStack) -> Memory:
    """Of this cell, and of this process alone: another's is refused. Raises CellError."""
    try:
        closing.enter_context(sole_user(state))
        return Memory(state, {"name": cell.name, "robot": cell.robot.name, "seed": cell.simulate.seed})
    except BadMemory as error:
        raise CellError(cell.path, [str(error)]) from None


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
