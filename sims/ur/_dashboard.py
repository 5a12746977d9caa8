"""The Dashboard server: commands in lines of text. Source: the maker's "Dashboard Server e-Series, port 29999"."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from sims.ur._controller import Controller
from sims.ur._modes import RobotMode, RuntimeState
from sims.ur._ports import Connection

GREETING = "Connected: Universal Robots Dashboard Server"
LOCAL = (
    "Command is not allowed due to safety reasons, please switch robot to Remote Control mode "
    "and reconnect to port 29999"
)
"""To a command that acts, in local control."""
TOO_EARLY = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking"
)
LONGEST = 4096
MODES = ("manual", "automatic")
ASKING = (
    "running", "robotmode", "get loaded program", "isProgramSaved", "programState", "PolyscopeVersion", "version",
    "safetymode", "safetystatus", "is in remote control", "get serial number", "get robot model",
    "get operational mode", "quit", "popup", "close popup", "addToLog", "close safety popup",
)  # fmt: skip
"""Commands that are allowed in local control too."""

Command = Callable[[str], str]


@final
class Dashboard:
    """The commands of a controller."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._operational = "NONE"
        runtime = controller.runtime
        self.commands: dict[str, Command] = {
            "load": self._load,
            "play": lambda _: _done(runtime.play(), "Starting program", "play"),
            "stop": lambda _: _done(self._stop(), "Stopped", "stop"),
            "pause": lambda _: _done(runtime.pause(), "Pausing program", "pause"),
            "quit": lambda _: "Disconnected",
            "shutdown": lambda _: self._shut_down(),
            "running": lambda _: f"Program running: {_word(runtime.state is RuntimeState.PLAYING)}",
            "robotmode": lambda _: f"Robotmode: {controller.mode.name}",
            "get loaded program": lambda _: (
                f"Loaded program: {runtime.loaded}" if runtime.loaded else "No program loaded"
            ),
            "popup": self._popup,
            "close popup": lambda _: self._close_popup("closing popup"),
            "addToLog": self._add_to_log,
            "isProgramSaved": lambda _: f"{_word(bool(runtime.loaded))} {runtime.name}",
            "programState": lambda _: f"{self._program_state()} {runtime.name}",
            "PolyscopeVersion": lambda _: f"URSoftware {self._version()} (simulated)",
            "version": lambda _: self._version(),
            "set operational mode": self._set_operational,
            "get operational mode": lambda _: self._operational,
            "clear operational mode": lambda _: self._clear_operational(),
            "power on": lambda _: _after(controller.power_on, "Powering on"),
            "power off": lambda _: _after(controller.power_off, "Powering off"),
            "brake release": lambda _: _after(controller.release_brakes, "Brake releasing"),
            "unlock protective stop": lambda _: "Protective stop releasing" if controller.unlock() else TOO_EARLY,
            "close safety popup": lambda _: self._close_popup("closing safety popup"),
            "restart safety": lambda _: _after(controller.restart_safety, "Restarting safety"),
            "safetymode": lambda _: f"Safetymode: {controller.safety.name}",
            "safetystatus": lambda _: f"Safetystatus: {controller.safety.name}",
            "is in remote control": lambda _: _word(controller.remote),
            "get serial number": lambda _: controller.serial,
            "get robot model": lambda _: controller.model_name,
        }

    def answer(self, line: str) -> str:
        """To one command."""
        name = max((name for name in self.commands if line == name or line.startswith(name + " ")), key=len, default="")
        if not name:
            return f"could not understand: '{line}'"
        if not self._controller.remote and name not in ASKING:
            return LOCAL
        return self.commands[name](line[len(name) :].strip())

    def conversation(self, connection: Connection) -> DashboardClient:
        """A new client."""
        return DashboardClient(self, connection)

    def _load(self, name: str) -> str:
        return f"Loading program: {name}" if self._controller.runtime.load(name) else f"File not found: {name}"

    def _stop(self) -> bool:
        """Also where none runs the arm is then at rest."""
        self._controller.runtime.stop()
        return self._controller.mode is not RobotMode.BOOTING

    def _shut_down(self) -> str:
        self._controller.power_off()
        return "Shutting down"

    def _popup(self, text: str) -> str:
        self._controller.popup = text
        return "showing popup"

    def _close_popup(self, answer: str) -> str:
        self._controller.popup = ""
        return answer

    def _add_to_log(self, text: str) -> str:
        if not text:
            return "No log message to add"
        self._controller.messages.log.append(text)
        return "Added log message"

    def _program_state(self) -> str:
        state = self._controller.runtime.state
        if state in (RuntimeState.PAUSED, RuntimeState.PAUSING):
            return "PAUSED"
        return "PLAYING" if state is RuntimeState.PLAYING else "STOPPED"

    def _version(self) -> str:
        return ".".join(map(str, self._controller.version))

    def _set_operational(self, mode: str) -> str:
        if mode not in MODES:
            return f"could not understand: 'set operational mode {mode}'"
        self._operational = mode.upper()
        return f"Operational mode {self._operational} is set"

    def _clear_operational(self) -> str:
        self._operational = "NONE"
        return "No longer controlling the operational mode. Current operational mode: AUTOMATIC"


@final
class DashboardClient:
    """One connection."""

    def __init__(self, dashboard: Dashboard, connection: Connection) -> None:
        self._dashboard, self._connection = dashboard, connection
        self._rest = b""
        connection.send(GREETING.encode() + b"\n")

    def feed(self, data: bytes) -> bool:
        """Take lines; False after `quit`, and after a line that does not end."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        for raw in lines:
            line = raw.decode("utf-8", "replace").strip()
            self._connection.send(self._dashboard.answer(line).encode() + b"\n")
            if line in ("quit", "shutdown"):
                return False
        return len(self._rest) < LONGEST

    def ended(self) -> None:
        """Nothing of it remains."""


def _done(done: bool, answer: str, command: str) -> str:
    return answer if done else f"Failed to execute: {command}"


def _after(action: Callable[[], object], answer: str) -> str:
    action()
    return answer


def _word(true: bool) -> str:
    return "true" if true else "false"
