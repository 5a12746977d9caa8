"""A simulated cell in a separate process: start, wait until ready, send the drivers' addresses, end."""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, final

from cellctl.clock import Clock, LockstepClock, WallClock
from cellctl.devices import Address, DeviceError, DeviceUnreachable
from cellctl.devices.cell import Cell, ClockMode
from cellctl.files import Document, InputError, Problem

_START_SECONDS = 60.0
_END_SECONDS = 20.0
_ANSWER_SECONDS = 20.0
"""Wall time limit for a program to start and end. If it dies, the wait ends at once."""


@final
@dataclass(frozen=True)
class SimulatedCell:
    """A running simulator process and the content of its ready file."""

    process: subprocess.Popen[bytes]
    folder: tempfile.TemporaryDirectory[str]
    ready: dict[str, Any]

    @classmethod
    async def start(cls, cell: Cell, seed: int | None, clock: ClockMode | None, extra: tuple[str, ...] = ()) -> Self:
        """Start the simulators of `cell` and wait until they listen.

        Raises InputError if the simulators refuse the cell file, DeviceUnreachable if they do not start.
        """
        folder = tempfile.TemporaryDirectory(prefix="cellctl-")
        ready = Path(folder.name) / "ready.json"
        command = simulator_command(cell.path, seed, clock, ready, ("--wait-for-host", *extra))
        with (Path(folder.name) / "stderr").open("wb") as errors:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=errors, stderr=errors, start_new_session=True
            )
        try:
            await _until_ready(process, ready)
        except BaseException:
            process.kill()
            process.wait()
            _explain(process, Path(folder.name) / "stderr", cell)
            folder.cleanup()
            raise
        return cls(process, folder, json.loads(ready.read_text()))

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
