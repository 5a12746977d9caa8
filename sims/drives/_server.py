"""The simulated drives put together: their bus, one drive per axis, SYNC, and their faults."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import partial
from typing import final
from urllib.parse import urlsplit

from sims.drives._address import SYNC, nodes_of
from sims.drives._bus import GROUP, MS, KernelNetwork, open_bus
from sims.drives._drive import Drive, Motor
from sims.simulator import CannotStart, Request, Setup

BOOT_NS = 500 * MS
ANSWER_NS = 1 * MS
"""From SYNC to the last PDO: six frames at 1 Mbit/s."""

_RESETS = (0x81, 0x82)


@final
class DriveServer:
    """The drives of the arm on a bus of their own. They measure at a SYNC, all at the same time."""

    def __init__(self, setup: Setup) -> None:
        self._kernel, self._faults = setup.kernel, setup.faults
        nodes = nodes_of(setup.address)
        joints = len(setup.cell.robot.joints)
        if len(nodes) != joints:
            raise CannotStart(f"{len(nodes)} nodes, and the robot has {joints} axes; write nodes=1,…,{joints}")
        for fault in setup.cell.simulate.faults:
            if fault.name.startswith("drives.") and fault.settings["node"] not in nodes:
                raise CannotStart(f"{fault.name}: there is no node {fault.settings['node']}")
        bus, port = open_bus()
        self._network = KernelNetwork(bus, setup.kernel, setup.wire, nodes[0], self._is_silent)
        self._network.on_host_frame = self._heard
        self.address = _simulated(setup.address, port)
        self.requests: dict[str, Request] = {}
        setup.scene.currents.brakes_after_ns = round(setup.settings["brakes_after_s"] * 1e9)
        seed = setup.cell.simulate.seed
        motors = motors_of(setup)
        self._drives = {
            node: Drive(node, 1000 * seed + axis, motor, self._network)
            for axis, (node, motor) in enumerate(zip(nodes, motors, strict=True), 1)
        }
        for drive in self._drives.values():
            drive.boot()
        self._faults.on_start("drives.reboot", lambda: self._of_fault("drives.reboot", self._reboot))
        self._faults.on_start("drives.emcy", lambda: self._of_fault("drives.emcy", self._fail))

    def close(self) -> None:
        """Leave the bus."""
        self._network.close()

    def _heard(self, can_id: int, data: bytes) -> None:
        """A frame from a master, besides SDO and NMT states, which the nodes take themselves."""
        if can_id == 0x80:
            self._sync()
        elif can_id == 0 and len(data) == 2 and data[0] in _RESETS:
            for node in self._drives if data[1] == 0 else [data[1]]:
                if node in self._drives:
                    self._reboot(self._drives[node])
        elif can_id & 0x780 == 0x200 and can_id & 0x7F in self._drives:
            self._drives[can_id & 0x7F].on_controlword(data)

    def _sync(self) -> None:
        self._faults.announce(SYNC)
        frames = [frame for drive in self._drives.values() for frame in drive.on_sync()]
        if frames:
            self._kernel.after(ANSWER_NS, partial(self._send, frames))

    def _send(self, frames: list[tuple[int, bytes]]) -> None:
        for can_id, data in frames:
            self._network.send_message(can_id, data)

    def _reboot(self, drive: Drive) -> None:
        drive.shut()
        self._kernel.after(BOOT_NS, drive.boot)

    def _fail(self, drive: Drive) -> None:
        fault = self._faults.active("drives.emcy")
        drive.fail(int(fault.settings["code"]) if fault else 0)

    def _of_fault(self, name: str, act: Callable[[Drive], object]) -> None:
        """Do something with the drive that the fault names."""
        fault = self._faults.active(name)
        if fault and fault.settings["node"] in self._drives:
            act(self._drives[fault.settings["node"]])

    def _is_silent(self, node: int) -> bool:
        fault = self._faults.active("drives.silent")
        return fault is not None and fault.settings["node"] == node


def motors_of(setup: Setup) -> list[Motor]:
    """The motors of the scene's arm, each with a noise of its own."""
    scene, share = setup.scene, setup.settings["noise"]
    motors = []
    for axis, rated_a in enumerate(scene.world.motors.rated_a):
        draw = random.Random(f"{setup.cell.simulate.seed} current of drive {axis + 1}")
        motors.append(
            Motor(
                current=partial(_of_axis, scene.motor_currents, axis),
                reading=partial(_of_axis, scene.arm.readings, axis),
                brake_closed=scene.currents.brakes_closed,
                standing_since=scene.arm.standing_since,
                rated_a=rated_a,
                noise=partial(draw.gauss, 0.0, share),
            )
        )
    return motors


def _of_axis(values: Callable[[], tuple[float, ...]], axis: int) -> float:
    return values()[axis]


def _simulated(address: str, port: int) -> str:
    """The address of the simulated bus, with the nodes as written."""
    query = "&".join(part for part in urlsplit(address).query.split("&") if not part.startswith("bitrate="))
    return f"canopen+udp-multicast://{GROUP}:{port}?{query}"
