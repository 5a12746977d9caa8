"""The engine's side of the cyclic process: starts, monitors and ends it; what RSI_ON the controller has run."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from typing import IO, Any, Self, final

from cellctl.devices import DeviceLost, DeviceRefused, DeviceUnreachable
from drivers.kuka_rsi.cyclic.limits import OnlineLimits, SearchLimits
from drivers.kuka_rsi.cyclic.process import ProcessSettings
from drivers.kuka_rsi.cyclic.session import InterpolationCycle
from drivers.kuka_rsi.cyclic.shared_block import SharedBlock
from drivers.kuka_rsi.settings import RsiSettings

REMEDY = (
    "Write into the robot's address what the controller's program passes to RSI_ON; or write the controller's files "
    "again (`cellctl krl`) and load all of them."
)


def in_words(cycle: InterpolationCycle) -> str:
    """`cycle=ipo (12 ms)`."""
    return f"cycle={cycle} ({cycle.milliseconds} ms)"


def refusal_of_program(device: str, ident: Mapping[str, str], settings: RsiSettings) -> DeviceRefused | None:
    """The error if `ident`, of HELLO, names another mode or cycle than the address; None if it names none.

    A program of older files names none: its first telegrams show the cycle, and the joints the mode.
    """
    wanted = {"Correction": settings.mode.upper(), "Cycle": settings.cycle.upper()}
    named = {key: ident[key] for key in wanted if key in ident}
    if named.items() <= wanted.items():
        return None
    rsi_on = ",".join(f"#{value}" for value in named.values())
    what = f"the controller's program has RSI_ON({rsi_on}), and the address mode={settings.mode}"
    return DeviceRefused(device, f"{what} and {in_words(settings.cycle)}", REMEDY)


def restarted(device: str, what_now: str) -> DeviceLost:
    """RSI was switched off and on within the tolerance, or telegrams were lost and no Delay refutes it."""
    return DeviceLost(
        device,
        "the controller's telegrams are not those of one RSI session (its count went on; its Delay, mark or programmed "
        f"joints are those of a new one): {what_now}",
        "Look at the pendant whether RSI was switched off and on, or the program reset. Where telegrams are only lost, "
        "look at the network; with DEF_Delay, or files written by `cellctl krl`, lost telegrams alone end no session.",
    )


_START_S = 60.0
_END_S = 10.0
"""Wall time limit for the process to start and end: imports take 1 s, many times that beside much other work; to end
it may wait for a fade (`process._LEAVE_S`, 3 s). If it dies, the wait ends at once."""


@final
class CyclicProcess:
    """A running cyclic process.

    `listening`: host and port bound; `heard`: the only accepted host; `tolerance`: cycles without an answer after
    which a session is over; `cycle`: of the controller, by the address; `block`: the memory shared with it; `granted`:
    its real-time settings, `fifo` (priority), `mlock` (locked memory) and `affinity` (its own processor).
    """

    def __init__(
        self,
        child: subprocess.Popen[bytes],
        settings: RsiSettings,
        block: SharedBlock,
        errors: IO[bytes],
        report: dict[str, Any],
    ) -> None:
        host, port = report["listening"]
        self.listening: tuple[str, int] = (host, port)
        self.heard = settings.heard
        self.tolerance = settings.tolerance
        self.cycle = settings.cycle
        self.granted: dict[str, bool] = {name: report[name] for name in ("fifo", "mlock", "affinity")}
        self.block = block
        self.pid = child.pid
        self._child = child
        self._errors = errors

    @classmethod
    async def start(
        cls,
        device: str,
        settings: RsiSettings,
        clock: str,
        reply: str,
        limits: SearchLimits,
        online: OnlineLimits | None = None,
    ) -> Self:
        """Start it and wait until it listens. Raises DeviceUnreachable if the port is taken or it dies.

        `clock`: source of the cell's time; `reply`: template of the reply; `online`: of corrections, low by default.
        """
        block, memory = SharedBlock.create()
        own = ProcessSettings(
            *settings.bind,
            settings.heard,
            settings.tolerance,
            memory,
            clock,
            reply,
            settings.mode,
            settings.cycle,
            asdict(limits),
            asdict(online or OnlineLimits()),
            os.getpid(),
        )
        errors = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process
        # -P: a file in the current folder, the user's, cannot take the place of a module
        command = [sys.executable, "-P", "-m", "drivers.kuka_rsi.cyclic.process", own.to_json()]
        try:
            child = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, pass_fds=[memory]
            )
        finally:
            os.close(memory)
        try:
            report = await _first_report(child)
        except TimeoutError:
            raise DeviceUnreachable(device, f"the RSI process did not start within {_START_S:g} s") from None
        if "listening" in report:
            return cls(child, settings, block, errors, report)
        await _reap(child)
        raise _cannot_listen(device, settings.bind, report, errors)

    def alive(self) -> bool:
        """Whether it runs."""
        return self._child.poll() is None

    def lost(self, device: str) -> DeviceLost | None:
        """The loss of `device` if the process has ended by itself, else None."""
        if self.alive():
            return None
        what = f"the RSI process ended: {_last_line(self._errors)}"
        return DeviceLost(device, what, "Look at this computer's log and memory, then go on.")

    async def end(self) -> None:
        """End it: by request, then by a kill if it does not exit."""
        self._child.terminate()
        await _reap(self._child)
        self._errors.close()


async def _first_report(child: subprocess.Popen[bytes]) -> dict[str, Any]:
    assert child.stdout is not None
    reading = asyncio.create_task(asyncio.to_thread(child.stdout.readline))
    try:
        async with asyncio.timeout(_START_S):
            line = await asyncio.shield(reading)
    except BaseException:
        child.kill()
        await reading
        await _reap(child)
        raise
    report: dict[str, Any] = json.loads(line) if line else {}
    return report


async def _reap(child: subprocess.Popen[bytes]) -> None:
    try:
        await asyncio.to_thread(child.wait, _END_S)
    except subprocess.TimeoutExpired:
        child.kill()
        await asyncio.to_thread(child.wait)
    if child.stdout:
        child.stdout.close()


def _cannot_listen(device: str, bind: tuple[str, int], report: dict[str, Any], errors: IO[bytes]) -> DeviceUnreachable:
    host, port = bind
    if report.get("errno") == errno.EADDRINUSE:
        cure = (
            f"End the program that holds it (ss -lunp 'sport = :{port}'), or choose another port here and in the XML."
        )
        return DeviceUnreachable(device, f"UDP port {port} on {host} is taken", cure)
    if "error" in report:
        cure = "The host in the address must be one of this computer's own, on the controller's RSI network."
        return DeviceUnreachable(device, f"cannot bind {host}:{port}: {report['error']}", cure)
    return DeviceUnreachable(device, f"the RSI process did not start: {_last_line(errors)}")


def _last_line(errors: IO[bytes]) -> str:
    errors.seek(0)
    lines = errors.read().decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "no message"
