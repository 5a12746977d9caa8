"""The KRL program on the controller: one command at a time, its state, and the message that stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import final

from sims.faults import MOVE, SEARCH, SEARCH_END
from sims.kernel import Event
from sims.krc._eki_messages import Code, Command, TableDesk, print_reply, print_state, read_command
from sims.krc._rsi_exchange import MS, RsiContext
from sims.krc._rsi_session import OwnProgram, PathCorrection, RsiSession
from sims.krc._xml_documents import Unreadable
from sims.memory import Memory
from sims.scene.contact import ContactLog
from sims.scene.motions import Joints
from sims.scene.safety import Safety

LEAST_PERCENT = 0.01
"""Slower, a move would take days: to the PC it looks as if it never ended."""

MODES = ("EXT", "T1")
"""Operating modes. T1 only shows: speeds are not reduced."""

EMERGENCY_STOP = "KSS00001 EMERGENCY STOP"
GUARD_OPEN = "KSS00207 Operator safety / safety fence open"
NO_ENABLE = "KSS00203 General motion enable"
COLLISION = "KSS00117 Collision detection: the tool has struck an obstacle"
NO_PC = "RSI_CREATE General error: ETHERNET1"
"""Messages as a controller shows them."""

NEAR_DEG = 0.01
"""An own program begins where the robot stands, as near as this."""

Send = Callable[[bytes], object]


@final
class Prog(StrEnum):
    """What the program does, as `Stat` shows it."""

    READY = "READY"
    MOVING = "MOVING"
    RSI = "RSI"
    STOPPED = "STOPPED"
    ERROR = "ERROR"


@final
@dataclass(slots=True)
class _Running:
    command: Command
    outcome: tuple[Code, str] = (Code.DONE, "")
    orphaned: bool = False


@final
class Program:
    """Takes commands as documents, answers through the connection's `send`, sends every change of state.

    `own_programs`: of the controller's user, by number.
    """

    def __init__(
        self, rsi: RsiContext, log: ContactLog, ident: str, tables: TableDesk, memory: Memory, safety: Safety
    ) -> None:
        self._rsi = rsi
        self._kernel = rsi.kernel
        self._robot = rsi.robot
        self._faults = rsi.faults
        self._log = log
        self._ident = ident
        self._tables = tables
        self._memory = memory
        self._safety = safety
        self._message = memory.recall("program", lambda state: str(state["message"])) or ""
        self._prog = Prog.ERROR if self._message else Prog.READY
        self._running: _Running | None = None
        self._braking = False
        self._halts: list[str] = []
        self._session: RsiSession | None = None
        self._path: PathCorrection | None = None
        self.own_programs: dict[int, OwnProgram] = {}
        self._rsi_on: Event | None = None
        self._send: Send | None = None
        self._sequence = 0
        self._mode = MODES[0]
        memory.keep("program", lambda: {"message": self._message})
        rsi.faults.on_start("robot.stop", lambda: self.fail(EMERGENCY_STOP))
        rsi.faults.on_start("rsi.restart", self._restart_rsi)
        safety.subscribe(self._safety_changed)
        self._robot.on_collision = lambda: self.fail(COLLISION)

    def connected(self, send: Send) -> None:
        """A PC has connected; the state is its greeting."""
        self._send = send
        self.send_state()

    def disconnected(self) -> None:
        """The connection is lost: motions are stopped; there is no receiver of replies."""
        self._send = None
        self._halts.clear()
        if self._running:
            self._running.orphaned = True
        if self._running or self._path:
            self._stop(Code.STOPPED, "the connection was lost")

    def send_state(self) -> None:
        """Send the state."""
        self._sequence += 1
        self._put(print_state(self._sequence, self._mode, self._prog, self._message, self._robot.readings()))

    def execute(self, document: bytes) -> None:
        """Execute a document's command, or reply why not."""
        try:
            command = read_command(document, len(self._rsi.limits))
        except Unreadable as error:
            self._reply(error.id, Code.UNREADABLE, str(error))
            return
        if command.op == "HELLO":
            self._reply(command.id, Code.DONE, "", self._ident)
        elif command.op == "HALT":
            self._halt(command)
        elif command.op == "TSTATE":
            self._ask_tables(command)
        elif self._running or self._braking:
            self._reply(command.id, Code.BUSY, "busy with another command")
        elif command.op == "RESET":
            self._reset(command)
        elif command.request is not None:
            self._ask_tables(command)
        else:
            self._begin(command)

    def restart(self) -> None:
        """The controller starts anew: what moves is braked, the message and what was staged are forgotten."""
        self._send = None
        self._halts.clear()
        self._tables.forget_staged()
        if self._running:
            self._running.orphaned = True
        self._change(Prog.STOPPED, "")
        self._stop(Code.STOPPED, "the controller was restarted")

    def fail(self, message: str) -> None:
        """The controller stops by itself and shows a message, which stands until RESET."""
        self._change(Prog.ERROR, message)
        if self._running or self._path:
            self._stop(Code.CONTROLLER_STOP, message)

    def select_mode(self, mode: str) -> None:
        """Somebody turns the mode selector; a motion is stopped."""
        if mode != self._mode:
            self._mode = mode
            if self._running or self._path:
                self._stop(Code.STOPPED, f"{mode} was selected")
            self.send_state()

    def acknowledge(self) -> bool:
        """Somebody acknowledges the message at the pendant; false where its cause is still there."""
        if self._safety.ok and not self._running and not self._braking:
            self._change(Prog.READY, "")
        return self._prog == Prog.READY

    def _reset(self, command: Command) -> None:
        if self.acknowledge():
            self._end_path()
            self._reply(command.id, Code.DONE)
        else:
            self._reply(command.id, Code.NOT_READY, self._open_chain())

    def _safety_changed(self) -> None:
        """The chain is wired to the drives: it brakes what moves, and shows a message in any state.

        Without the PLC's enable only a motion is stopped; at rest the controller waits for it without a message.
        """
        if not self._safety.ok:
            self.fail(self._open_chain())
        elif not self._safety.motion_enabled and (self._running or self._path):
            self.fail(NO_ENABLE)

    def _open_chain(self) -> str:
        return EMERGENCY_STOP if not self._safety.emergency_stop_ok else GUARD_OPEN

    def _ask_tables(self, command: Command) -> None:
        if command.request is not None:
            self._reply(command.id, *self._tables.ask(command.request))

    def _begin(self, command: Command) -> None:
        target = self._tables.target(command.row) if command.op == "PTPT" else command.target
        refusal = self._refusal(command, target)
        if refusal:
            self._reply(command.id, *refusal)
            return
        self._running = _Running(command)
        self._change(Prog.MOVING, "")
        match command.op:
            case "RSI" | "CORRON":
                cycle = self._rsi.settings.cycle_ms * MS
                start = self._start_rsi if command.op == "RSI" else self._start_path
                self._rsi_on = self._kernel.at((self._kernel.now // cycle + 1) * cycle, start)
            case "CORROFF":
                self._leave_path()
            case "OWN":
                self._run(self.own_programs[command.row])
            case _ if target is not None:
                self._move(target, command.percent)

    def _refusal(self, command: Command, target: Joints | None) -> tuple[Code, str] | None:
        if self._prog == Prog.ERROR:
            return Code.NOT_READY, self._message
        if not self._safety.motion_enabled:
            return Code.NOT_READY, NO_ENABLE
        if self._mode != MODES[0] and self._rsi.settings.t1 == "refused":
            return Code.NOT_READY, "the mode is not EXT"
        if command.op in ("RSI", "CORRON") and self._path:
            return Code.BUSY, "RSI is on beside the program's motions"
        if command.op in ("RSI", "CORRON", "CORROFF"):
            return None
        if command.op == "OWN":
            return self._refusal_of_own(command.row)
        if not LEAST_PERCENT <= command.percent <= 100.0:
            return Code.BAD_SPEED, f"speed {command.percent} % is outside {LEAST_PERCENT} … 100 %"
        if target is None:
            return Code.NO_SUCH_ROWS, f"the active table has no row {command.row}"
        for i, (angle, (low, high)) in enumerate(zip(target, self._rsi.limits, strict=True), 1):
            if not low <= angle <= high:
                return Code.OUTSIDE_LIMIT, f"A{i} {angle:.4f} is outside {low} … {high}"
        return None

    def _refusal_of_own(self, number: int) -> tuple[Code, str] | None:
        own = self.own_programs.get(number)
        if own is None:
            return Code.NO_SUCH_ROWS, f"there is no own program {number}"
        if any(abs(a - b) > NEAR_DEG for a, b in zip(own.first, self._robot.commanded, strict=True)):
            return Code.NOT_READY, f"own program {number} does not begin here"
        return None

    def _move(self, target: Joints, percent: float) -> None:
        self._faults.announce(MOVE)
        if self._path:
            self._path.run(
                lambda start, now: self._robot.point_to_point(start, target, percent, now), target, self._arrived
            )
        else:
            self._robot.move(target, percent, self._arrived)

    def _run(self, own: OwnProgram) -> None:
        if self._path:
            self._path.run(own.begun, own.last, self._arrived)
        else:
            self._robot.run(own.begun(own.first, self._kernel.now), own.last, self._arrived)

    def _start_path(self) -> None:
        """RSI_ON without RSI_MOVECORR: from now on it corrects what the program does."""
        self._rsi_on = None
        if not self._rsi.link.has_target:
            self.fail(NO_PC)
            return
        self._path = PathCorrection(self._rsi, self.fail)
        self._arrived()
        self._rsi_on = self._kernel.at(self._kernel.now, self._path.start)  # behind the reply, as with a search

    def _restart_rsi(self) -> None:
        """RSI_OFF and RSI_ON in one program, which tells the PC nothing: the new session's zero is where it stands."""
        if session := self._session or self._path:
            session.abort()
            self._robot.brake(self._rsi_again)

    def _rsi_again(self) -> None:
        self._robot.take_measured()
        cycle = self._rsi.settings.cycle_ms * MS
        at = (self._kernel.now // cycle + self._rsi.settings.restart_cycles) * cycle

        def begin() -> None:
            if self._session:
                self._session = RsiSession(self._rsi, self._rsi_ended)
                self._session.start()
            elif self._path:
                self._path = PathCorrection(self._rsi, self.fail)
                self._path.start()

        self._rsi_on = self._kernel.at(at, begin)

    def _leave_path(self) -> None:
        """RSI_OFF, and `PTP $AXIS_ACT_MEAS`."""
        self._end_path()
        self._robot.brake(self._left_path)

    def _end_path(self) -> None:
        """RSI off: by command, by a stop, or with the program that is selected anew."""
        if self._path:
            self._path.abort()
            self._path = None

    def _left_path(self) -> None:
        self._robot.take_measured()
        self._arrived()

    def _start_rsi(self) -> None:
        running, self._rsi_on = self._running, None
        if not running:  # cannot be: HALT takes the event back
            return
        if not self._rsi.link.has_target:
            self.fail(NO_PC)
            return
        self._log.begin(self._faults.announce(SEARCH), self._robot.attempt)
        self._session = RsiSession(self._rsi, self._rsi_ended)
        self._change(Prog.RSI, "")
        self._reply(running.command.id, Code.RSI_ON)
        self._rsi_on = self._kernel.at(self._kernel.now, self._session.start)  # after the faults that begin with it

    def _rsi_ended(self, message: str) -> None:
        if message:
            self.fail(message)
            return
        self._robot.take_measured()
        self._arrived()

    def _halt(self, command: Command) -> None:
        if not self._running and not self._path:
            self._reply(command.id, Code.DONE)
            return
        self._halts.append(command.id)
        self._stop(Code.STOPPED, "stopped by HALT")

    def _stop(self, code: Code, text: str) -> None:
        """Brake; the running command ends with `code` when the robot stands. A controller's message has precedence."""
        if self._running and self._running.outcome[0] != Code.CONTROLLER_STOP:
            self._running.outcome = code, text
        if self._rsi_on:
            self._rsi_on.cancel()
        if self._session:
            self._session.abort()
        self._end_path()
        if not self._braking:
            self._braking = True
            self._robot.brake(self._stands)

    def _stands(self) -> None:
        self._braking = False
        self._robot.take_measured()
        self._change(Prog.ERROR if self._message else Prog.STOPPED, self._message)
        self._finish()

    def _arrived(self) -> None:
        self._change(Prog.READY, "")
        self._finish()

    def _finish(self) -> None:
        """The last replies: to the command that ran, to those that halted it. Where it stands is remembered first."""
        self._memory.save()
        running, self._running = self._running, None
        searched, self._session = self._session is not None, None
        if running and not running.orphaned:
            self._reply(running.command.id, *running.outcome)
        for command_id in self._halts:
            self._reply(command_id, Code.DONE)
        self._halts.clear()
        if searched:
            self._faults.announce(SEARCH_END)

    def _change(self, prog: Prog, message: str) -> None:
        if (prog, message) != (self._prog, self._message):
            remembered = message != self._message
            self._prog, self._message = prog, message
            if remembered:
                self._memory.save()
            self.send_state()

    def _reply(self, command_id: str, code: Code, text: str = "", inner: str = "") -> None:
        self._put(print_reply(command_id, code, text, self._robot.readings(), inner))

    def _put(self, document: bytes) -> None:
        if self._send:
            self._send(document)
