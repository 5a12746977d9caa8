"""The simulated controller, put together: variables, program and proxy of the scene's arm."""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Any, final

from sims.scene.motions import Joints
from sims.simulator import CannotStart, Refused, Request, Setup, with_settings
from sims.varproxy import _proxy
from sims.varproxy._program import KvpProgram
from sims.varproxy._proxy import (
    C3,
    GENERAL,
    PROTOCOL,
    READ,
    ROW,
    WRITE,
    BadRequest,
    Fields,
    FileDesk,
    ProxyServer,
)
from sims.varproxy._variables import AXES, Bool, DataList, Index, Int, System, Variable, Variables
from sims.varproxy._variables import Refused as NoVariable

KSS = "V8.6.11"
FLAGS, TIMERS = 1024, 64
READ_VARIABLE, WRITE_VARIABLE = 0, 1


@final
class KvpController:
    """The controller's end on the wire."""

    def __init__(self, setup: Setup) -> None:
        joints = setup.cell.robot.joints
        if len(joints) != AXES:
            raise CannotStart(f"this controller drives six axes; the robot file has {len(joints)}")
        self._setup, self._c3 = setup, setup.settings["proxy"] == C3
        self.data = DataList()
        message = setup.memory.recall("varproxy", self._recall) or ""
        limits = tuple((joint.min, joint.max) for joint in joints)
        self.program = KvpProgram(setup.kernel, setup.scene, setup.faults, setup.memory, self.data, limits)
        self.program.message = message
        self.data.table.changed = self._row_written
        self.data.roles.changed = lambda index: setup.memory.save()
        setup.memory.keep("varproxy", lambda: {**self.data.state(), "message": self.program.message})
        self.variables = Variables({**self.data.variables, **self._system()}, self._unloaded)
        self.server = ProxyServer(setup, self._answer, {})
        self.address = with_settings(setup.address, f"127.0.0.1:{self.server.port}").rstrip("?")
        self.requests: dict[str, Request] = {"acknowledge": lambda message: self.acknowledge()}

    def acknowledge(self) -> None:
        """Acknowledge the message at the pendant and start the program. Raises Refused."""
        if not self.program.acknowledge():
            raise Refused("the controller moves, or its safety chain is open")

    def close(self) -> None:
        """Hang up, and let go of the port."""
        self.server.close()

    def _unloaded(self, name: str) -> bool:
        return name.startswith("KV_") and self._setup.faults.active("varproxy.unloaded") is not None

    def _recall(self, state: Mapping[str, Any]) -> str:
        """Take the tables over; the message that stood."""
        self.data.recall(state)
        return str(state["message"])

    def _row_written(self, index: Index) -> None:
        """A row of a table was written; the fault `varproxy.alters` changes its last digit."""
        self._setup.faults.announce(ROW)
        if self._setup.faults.active("varproxy.alters"):
            row = self.data.table.values[index]
            self.data.table.values[index] = {**row, "C6": row["C6"] + 1}

    def _answer(self, request: _proxy.Request, files: FileDesk) -> bytes:
        number, kind, fields = request.number, request.kind, Fields(request.body)
        if kind in (READ_VARIABLE, WRITE_VARIABLE):
            return self._variable(number, kind, fields)
        if not self._c3:
            return _proxy.no_message(number)
        if kind not in (WRITE, READ):
            return b""
        try:
            code, body = files.write(fields) if kind == WRITE else files.read(fields)
        except BadRequest:
            code, body = PROTOCOL, b""
        return _proxy.answer(number, kind, body, code)

    def _variable(self, number: int, kind: int, fields: Fields) -> bytes:
        """What fails has no text and code 0 of the C3 Bridge.

        KUKAVARPROXY always has code 1: a variable that it cannot read is empty, as if it had been read; one that it
        cannot write is echoed, FALSE at the end.
        """
        value = ""
        try:
            name = fields.text()
            if kind == READ_VARIABLE:
                value = self._own(name) or self.variables.read(name)
            else:
                value = fields.text()
                self.variables.write(name, value)
        except (BadRequest, NoVariable):
            if self._c3:
                return _proxy.answer(number, kind, _proxy.text(""), GENERAL)
            return _proxy.answer(number, kind, _proxy.text(value), ok=kind == READ_VARIABLE)
        return _proxy.answer(number, kind, _proxy.text(value))

    def _own(self, name: str) -> str:
        """Variables of the proxy itself, which the controller does not know."""
        known = {"@PROXY_TYPE": "C3 BRIDGE INTERFACE", "@PROXY_VERSION": "1.6 (OPEN SOURCE)"} if self._c3 else {}
        return {"PING": "PONG", **known}.get(name, "")

    def _system(self) -> dict[str, Variable]:
        setup, program = self._setup, self.program
        arm, limits = setup.scene.arm, program.limits
        truth, whole = Bool(), Int()

        def set_flag(index: Index, text: str) -> None:
            program.set_flag(index[0], on=truth.read(text, False))

        def set_timer(index: Index, text: str) -> None:
            program.timer(index[0]).set(whole.read(text, 0))
            program.timer_changed()

        def stop_timer(index: Index, text: str) -> None:
            program.timer(index[0]).stop(stopped=truth.read(text, False))
            program.timer_changed()

        return {
            "KV_BEAT": System(lambda _: str(program.beat)),
            "$KR_SERIALNO": System(lambda _: f'"{_serial(setup.cell.simulate.seed)}"'),
            "$MODEL_NAME": System(lambda _: f'"{setup.cell.robot.name}"'),
            "$ROBNAME": System(lambda _: '"SIMULATED"'),
            "$V_R1MADA": System(lambda _: f'"{KSS}"'),
            "$MODE_OP": System(lambda _: "#EX"),
            "$PRO_STATE1": System(lambda _: "#P_STOP" if program.message else "#P_ACTIVE"),
            "$PRO_NAME1": System(lambda _: '"/R1/CELLCTL_KVP()"'),
            "$PERI_RDY": System(lambda _: truth.shown(setup.scene.safety.ok)),
            "$STOPMESS": System(lambda _: truth.shown(bool(program.message))),
            "$ROB_STOPPED": System(lambda _: truth.shown(program.stands)),
            "$AXIS_ACT": System(lambda _: _e6axis(arm.commanded if program.stands else arm.readings())),
            "$AXIS_ACT_MEAS": System(lambda _: _e6axis(arm.readings())),
            "$SOFTN_END": System(lambda index: f"{limits[index[0] - 1][0]:.6f}", size=AXES),
            "$SOFTP_END": System(lambda index: f"{limits[index[0] - 1][1]:.6f}", size=AXES),
            "$FLAG": System(lambda index: truth.shown(index[0] in program.flags), set_flag, FLAGS),
            "$TIMER": System(lambda index: str(program.timer(index[0]).value_ms), set_timer, TIMERS),
            "$TIMER_STOP": System(lambda index: truth.shown(program.timer(index[0]).stopped), stop_timer, TIMERS),
            "$TIMER_FLAG": System(lambda index: truth.shown(program.timer(index[0]).value_ms >= 0), size=TIMERS),
        }


def start(setup: Setup) -> KvpController:
    """Start the proxy and the controller of the scene's arm. Raises CannotStart, BadMemory."""
    return KvpController(setup)


def _serial(seed: int) -> str:
    """Of the cell's robot: the same by whatever channel it is asked. A number on a real controller."""
    draw = random.Random(f"{seed} controller")
    draw.randrange(10_000, 1_000_000_000)
    return f"SIM-{draw.randrange(10**6):06d}"


def _e6axis(joints: Joints) -> str:
    axes = [f"A{axis} {angle:.6f}" for axis, angle in enumerate(joints, 1)]
    return "{E6AXIS: " + ", ".join([*axes, *(f"E{axis} 0.0" for axis in range(1, 7))]) + "}"
