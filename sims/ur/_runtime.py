"""The program of the controller: started, paused, stopped, and executed cycle by cycle; its watchdogs and its files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, final

from sims.ur._modes import RuntimeState
from sims.ur._motion import Motion
from sims.ur._script_expressions import ScriptError
from sims.ur._script_machine import Builtin, Machine, is_blocking, run_at_once
from sims.ur._script_parser import Names, Script, parsed

ACTIONS = ("ignore", "pause", "stop")
UNNAMED = "<unnamed>"


@final
@dataclass(slots=True)
class Watchdog:
    """Of one input. `period_ns`: the longest time between two updates; `heard_ns`: the last one."""

    period_ns: int
    action: str
    heard_ns: int


class Reports(Protocol):
    """Where messages of a program go."""

    def key(self, title: str, text: str) -> None:
        """A program began or ended."""

    def exception(self, error: ScriptError) -> None:
        """A program cannot be compiled or go on."""

    def error(self, code: int, argument: int, text: str) -> None:
        """A message with a code."""


@final
class Runtime:
    """One program at a time; `ready`: whether the arm can move. `started`: called when one begins."""

    def __init__(
        self,
        motion: Motion,
        reports: Reports,
        folder: Path | None,
        ready: Callable[[], bool],
        started: Callable[[], object],
    ) -> None:
        self.state = RuntimeState.STOPPED
        self.machine: Machine | None = None
        self.loaded = ""
        self.watchdogs: dict[str, Watchdog] = {}
        self.builtins: Mapping[str, Builtin] = {}
        self.on_ended: Callable[[], object] = lambda: None
        self._motion, self._reports, self._folder = motion, reports, folder
        self._ready, self._started = ready, started

    @property
    def name(self) -> str:
        """Of the program, as Dashboard shows it."""
        return self.loaded or UNNAMED

    @property
    def active(self) -> bool:
        """Whether a program is there, running or paused."""
        return self.machine is not None

    @property
    def line(self) -> int:
        """Where the program is."""
        return self.machine.line if self.machine else 0

    def take(self, text: str) -> None:
        """A program that a client has sent: it is executed in place of the one that runs; a secondary one beside it."""
        try:
            script = self._parsed(text)
            if script.secondary:
                run_at_once(script, self.builtins)
            else:
                self._begin(script)
        except ScriptError as error:
            self._reports.exception(error)

    def load(self, name: str) -> bool:
        """Load NAME.urp; False where there is none. What runs is stopped."""
        path = self._path(name)
        if path is None:
            return False
        self.stop()
        self.loaded = name
        return True

    def play(self) -> bool:
        """Start the loaded program, or go on with the paused one; False where that cannot be."""
        if not self._ready():
            return False
        if self.state in (RuntimeState.PAUSED, RuntimeState.PAUSING):
            self.state, self._motion.pausing = RuntimeState.PLAYING, False
            return True
        path = self._path(self.loaded)
        if path is None or self.active:
            return False
        try:
            self._begin(self._parsed(path.read_text(encoding="utf-8")))
        except ScriptError as error:
            self._reports.exception(error)
            return False
        return True

    def pause(self) -> bool:
        """Brake along the path, and hold the program."""
        if self.state is not RuntimeState.PLAYING:
            return False
        self.state, self._motion.pausing = RuntimeState.PAUSING, True
        return True

    def hold(self) -> None:
        """The arm is stopped off its path: the program waits, and goes on from there when it is played."""
        self._motion.interrupt()
        if self.active:
            self.state = RuntimeState.PAUSED
        self._motion.pausing = False

    def stop(self) -> bool:
        """End the program; the arm is braked."""
        if self.machine is None:
            return False
        name = self.machine.name
        self.machine.stop()
        self.machine = None
        self.state, self._motion.pausing = RuntimeState.STOPPED, False
        self.watchdogs.clear()
        self.on_ended()
        self._reports.key("PROGRAM_XXX_STOPPED", name)
        return True

    def updated(self, inputs: Mapping[str, object], now: int) -> None:
        """RTDE has received these inputs."""
        for name in inputs:
            if watchdog := self.watchdogs.get(name):
                watchdog.heard_ns = now

    def set_watchdog(self, name: str, frequency: float, action: str, now: int) -> None:
        """`rtde_set_watchdog`. Raises ScriptError."""
        if action not in ACTIONS or frequency <= 0.0:
            raise ScriptError(f"rtde_set_watchdog: {action} is none of {', '.join(ACTIONS)}, or no frequency above 0")
        self.watchdogs[name] = Watchdog(round(1e9 / frequency), action, now)

    def cycle(self, now: int) -> None:
        """One cycle of the program that plays."""
        if self.state not in (RuntimeState.PLAYING, RuntimeState.PAUSING) or self.machine is None:
            return
        self._look_at_watchdogs(now)
        if self.machine is None or (self.state is RuntimeState.PAUSING and self._motion.paused):
            if self.machine is not None:
                self.state = RuntimeState.PAUSED
            return
        machine = self.machine
        try:
            machine.cycle()
        except ScriptError as error:
            self._reports.exception(error)
        if machine.ended and machine is self.machine:
            self.stop()

    def _look_at_watchdogs(self, now: int) -> None:
        late = [(name, dog) for name, dog in self.watchdogs.items() if now - dog.heard_ns > dog.period_ns]
        for name, dog in late:
            dog.heard_ns = now
            if dog.action == "ignore":
                continue
            self._reports.error(0, 0, f"RTDE watchdog: no update of {name}")
            if dog.action == "pause":
                self.pause()
            else:
                self.stop()
                return

    def _begin(self, script: Script) -> None:
        if not self._ready():
            raise ScriptError("the robot is not ready: no program is started")
        self.stop()
        self.machine = Machine(script, self.builtins)
        self.state = RuntimeState.PLAYING
        self._reports.key("PROGRAM_XXX_STARTED", script.name)
        self._started()

    def _parsed(self, text: str) -> Script:
        at_once = [name for name, function in self.builtins.items() if not is_blocking(function)]
        return parsed(text, Names(at_once, self.builtins.keys()))

    def _path(self, name: str) -> Path | None:
        """The script of NAME.urp: in the folder of programs, and nowhere else."""
        stem = Path(name).name.removesuffix(".urp")
        path = self._folder / f"{stem}.script" if self._folder and stem else None
        return path if path and path.is_file() else None
