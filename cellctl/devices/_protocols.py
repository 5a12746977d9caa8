"""The protocols of devices, by their callers' needs. Drivers implement them; only drivers handle wire formats.

All waiting is in the cell's time. Joint readings are the controller's own A1…An in degrees.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Protocol, TypeVar, final, runtime_checkable

from cellctl.clock import Clock

AnyProtocol = TypeVar("AnyProtocol", bound=type)

_OBSERVING: set[type] = set()


def observes(protocol: AnyProtocol) -> AnyProtocol:
    """Declare that devices of this Protocol only read or stop: what is interrupted leaves nothing uncertain."""
    _OBSERVING.add(protocol)
    return protocol


def acts(protocol: type) -> bool:
    """Whether devices of this Protocol move or write: so does every one that is not declared by `observes`.

    A Protocol derived from an observing one acts, until it is declared itself.
    """
    return protocol not in _OBSERVING


JointReadings = tuple[float, ...]
"""A1…An in degrees, as the controller shows them: `(0.0, -90.0, 90.0, 0.0, 45.0, 0.0)`."""


@final
@dataclass(frozen=True, slots=True)
class Identity:
    """The identity that a device reports. `simulated`: its serial or name marks it as simulated."""

    device: str
    serial: str
    model: str
    firmware: str
    simulated: bool


@final
@dataclass(frozen=True, slots=True)
class Health:
    """The health of a device: whether it is in order, and its figures (`{"late": 0, "loop_mV": 1650}`).

    mode: a robot's operating mode as its controller names it (`EXT`, `T1`); empty: not reported.
    """

    ok: bool
    text: str
    figures: dict[str, float] = field(default_factory=dict)
    mode: str = ""


@observes
@runtime_checkable
class Device(Protocol):
    """The methods of every device."""

    name: str

    async def connect(self) -> Identity:
        """Open the line and read the identity. Raises DeviceUnreachable; nothing moves."""

    async def health(self) -> Health:
        """The device's health. Raises DeviceLost."""

    async def stop(self) -> None:
        """Bring it to its safe state (robot held, probe disarmed). Never raises if it is already safe.

        A return is the confirmation: without one it raises DeviceUncertain, and the run ends as uncertain.
        """

    async def close(self) -> None:
        """Stop, and close the line. Never raises."""


@observes
@runtime_checkable
class Listener(Protocol):
    """A device whose driver binds a port and waits for the controller to connect."""

    def listening(self) -> tuple[str, int]:
        """Host and port that it listens on, once its own process is connected: `("127.0.0.1", 49152)`."""


class SearchEnd(StrEnum):
    """Why a search ended. In every case the robot is held, and the controller takes no further corrections."""

    STOPPED = "stopped"
    """`stop_now` was called: contact."""
    TRAVEL = "travel"
    """The end of the line was reached without a stop."""


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The record of a search, sampled every cycle of the controller. A driver may return more (a subclass).

    `times_ns`: the cell's time of each sample, fitted to the controller's own clock or count; `joints`: A1…An actual,
    degrees, a row per sample; `resting`: the joints after the stop. `stop_cycles`: cycles from the first one answered
    with the stop known to the first with a constant set-point; `late`, `lost`, `skipped`: answers, or messages of the
    controller, so counted during this search.
    """

    end: SearchEnd
    times_ns: tuple[int, ...]
    joints: tuple[JointReadings, ...]
    resting: JointReadings
    stop_cycles: int
    late: int
    lost: int
    skipped: int

    def joints_at(self, time_ns: int) -> JointReadings:
        """Actual joints at `time_ns`, interpolated linearly between the samples around it.

        Raises ValueError if `time_ns` is outside the samples.
        """
        times = self.times_ns
        if len(times) < 2 or not times[0] <= time_ns <= times[-1]:
            raise ValueError(f"time {time_ns} ns lies outside the search's samples")
        after = bisect_left(times, time_ns, lo=1)
        t0, t1 = times[after - 1], times[after]
        share = (time_ns - t0) / (t1 - t0) if t1 > t0 else 0.0
        before_row, after_row = self.joints[after - 1], self.joints[after]
        return tuple(a + share * (b - a) for a, b in zip(before_row, after_row, strict=True))


class Guard(Protocol):
    """Proof of life of another device: the robot holds by itself when the last beat is older than the guard allows."""

    def beat(self, time_ns: int) -> None:
        """The device was alive at `time_ns` of the cell's clock. Safe from any thread; never blocks."""


@observes
@runtime_checkable
class JointReader(Device, Protocol):
    """A robot whose joints are read; it is moved by somebody else, or not at all."""

    @property
    def axes(self) -> int:
        """Number of joints."""

    async def joints(self) -> JointReadings:
        """Actual joint readings now. Raises DeviceLost."""


@final
@dataclass(frozen=True, slots=True)
class ArmRows:
    """Denavit-Hartenberg rows of an arm, Rz(θ + q) Tz(d) Tx(a) Rx(α): theta, alpha in rad, a, d in mm, by joint."""

    theta: tuple[float, ...]
    a: tuple[float, ...]
    d: tuple[float, ...]
    alpha: tuple[float, ...]


@observes
@runtime_checkable
class CalibratedArm(Device, Protocol):
    """A robot whose controller states the geometry that it computes with: its maker's calibration of the arm."""

    async def arm_rows(self) -> ArmRows:
        """The controller's own rows. Raises DeviceLost, DeviceUnreachable."""


@runtime_checkable
class MovingRobot(JointReader, Protocol):
    """A robot that moves from point to point."""

    async def move(self, target: JointReadings, speed_percent: float) -> JointReadings:
        """Point to point, planned by the controller; returns the actual joints on arrival.

        Raises LimitExceeded, DeviceFault (the controller stopped), DeviceLost. Held in every case.
        Cancelling it stops the robot.
        """


@runtime_checkable
class StoppedUntilCleared(Protocol):
    """A device whose stop stays set, and refuses every later motion, until it is cleared."""

    def clear_stop(self) -> None:
        """Clear any stop; call it *before* arming the device that may set the next one."""


@runtime_checkable
class SearchingRobot(MovingRobot, StoppedUntilCleared, Protocol):
    """A robot that moves from point to point and searches for contact."""

    async def search(
        self, end: JointReadings, speed_deg_s: float, guards: dict[str, float] | None = None
    ) -> SearchResult:
        """Go along the joint-space line from here to `end` until `stop_now`, the end, or trouble.

        `speed_deg_s`: rate of the Euclidean norm of the joint vector, deg/s. `guards`: name → oldest allowed beat in
        seconds; the robot holds by itself when one is older. Raises LimitExceeded (nothing moved), DeviceFault
        (controller fault, late count), DeviceLost (no telegram, a guard too old). The robot is held in every case.
        Cancelling it stops and holds the robot. While a stop is set it ends STOPPED at its start.
        """

    def stop_now(self) -> None:
        """Stop the running search within the next cycle, and every later one before it moves, until `clear_stop`.

        Safe from any thread; never blocks. So a stop that was set before the search began is never lost.
        """

    def guard(self, name: str) -> Guard:
        """The slot that passes another device's proof of life to the cyclic process."""


@final
@dataclass(frozen=True, slots=True)
class Contact:
    """A contact as the probe reported it.

    `time_ns`: the cell's time of the first edge, through the tick → cell clock fit, with its 1 σ; `tick`: the raw
    hardware count; `confirmed`: the level held, or None if not reported; `bounces`: further edges within the
    debounce time.
    """

    time_ns: int
    sigma_ns: int
    tick: int
    confirmed: bool | None
    bounces: int


@observes
@runtime_checkable
class ContactProbe(Device, Protocol):
    """A probe that closes a loop when its tip touches."""

    async def arm(self, on_edge: Callable[[], None], on_alive: Callable[[int], None]) -> None:
        """Verify that the loop is open and whole, and arm.

        `on_edge` is called from the probe's own thread at the first edge, and on a wire break, a reset or a fault,
        *before* the line is acknowledged; `on_alive` at every sign of life, with the cell's time. Neither may block.
        Raises ProbeNotOpen, DeviceFault (wire break), DeviceLost.
        """

    async def contact(self) -> Contact:
        """Wait for the contact after `arm`, confirmed, refuted or neither. Raises DeviceFault, DeviceLost."""

    async def touching(self) -> bool:
        """Whether the loop is closed, as the probe measured it after this call.

        Raises DeviceFault if the probe has a fault, or the search since `arm` ended with one; DeviceLost.
        """

    async def disarm(self) -> None:
        """Disarm. Raises DeviceLost."""


TABLE_CORRECTION_DEG = 2.0
"""Default limit of a table's correction of a joint, deg: a robot of this class is within half a degree; rows near a
singularity are not."""


@final
@dataclass(frozen=True, slots=True)
class Surroundings:
    """The data for a driver besides its address.

    `clock`: the cell's time; `folder`: the cell file's folder, against which paths in an address are read; `limits`:
    the cell file's limits for this device, in the driver's own names; missing ones take the driver's defaults, which
    are low. `reach_mm`: of the cell's robot, all links and the tool stretched out (more than its maker's reach),
    `axes`: their number; None if unknown. `table_correction_deg`: largest correction of a joint by a table. `state`:
    folder for what a driver keeps beyond its own life, of a simulated cell; None: beside the cell file.
    """

    clock: Clock
    folder: Path
    limits: dict[str, float] = field(default_factory=dict)
    reach_mm: float | None = None
    axes: int | None = None
    table_correction_deg: float = TABLE_CORRECTION_DEG
    state: Path | None = None


@final
@dataclass(frozen=True, slots=True)
class Finding:
    """A driver's finding in a device's part of the cell file, without opening the device.

    `what`: the error, or an allowed but probably unintended value (`warning`); `cure`: what to do. `limit`: the name
    of the limit concerned; empty if the address is concerned.
    """

    what: str
    cure: str = ""
    limit: str = ""
    warning: bool = False


@final
@dataclass(frozen=True, slots=True)
class CorrectionModel:
    """A model as arrays of plain numbers, row by row; `id`: of its file. mm, rad, K waves, M nodes, n joints.

    `sign`, `offset` (n): model angle = sign · reading + offset. `base`, `tool` (4, 4), `links` (n + 1, 4, 4): the
    controller's kinematics, base · L0 Rz(q1) L1 … Rz(qn) Ln · tool. `identified` (n + 1, 4, 4): the same of the
    identified robot, with its base and tool; `identified_base` (3, 3): its base's rotation. `down` (3): ĝ in the base.
    `weight` (n, 2, n): rad of joint j per weight along x, y of the frame behind joint k, as [k, x or y, j]. `load` (n):
    rad per mm of the payload's lever; `load_place` (3): of the payload, flange frame. `bend`: mm of a horizontal tool.
    `stretch` (n + 1): shares of the frames' origins, the flange last, by which the TCP shifts. `wave_joint` (from 0),
    `wave_order`, `wave_sine`, `wave_cosine` (K): joint j turns by s sin mq + c (cos mq − 1). `node_place`,
    `node_scale` (M, n), `node_weight` (3, M): the TCP shifts by w exp(−½ |q · scale − place|²). `lower`, `upper` (n):
    measured region, readings in degrees; `fade`: outside it the correction fades to zero over so many degrees.
    """

    id: str
    arrays: Mapping[str, tuple[float, ...]]


@final
@dataclass(frozen=True, slots=True)
class CorrectionSample:
    """One of the samples that are kept at a reduced rate: `time_ns` of the cell's time, programmed joints and
    correction, degrees; `inside`: the share by which the correction is faded.
    """

    time_ns: int
    programmed: JointReadings
    correction: JointReadings
    inside: float


@final
@dataclass(frozen=True, slots=True)
class CorrectionReport:
    """What an on-line correction did. `cycles`: answered with one; of these `limited`: cut by a limit, and `outside`
    the measured region, wholly or in part. `late`, `lost`: answers. `refused_models`: that were not valid.
    """

    cycles: int
    limited: int
    outside: int
    late: int
    lost: int
    refused_models: int


@runtime_checkable
class CorrectingRobot(MovingRobot, Protocol):
    """A robot that can be corrected on-line. While that is on, it moves from point to point as ever."""

    async def correction_on(self, model: CorrectionModel) -> None:
        """Begin, at rest: from zero, the correction follows the model within its limits.

        Raises DeviceRefused (another one is on, the controller's set-up does not allow it, arrays of another robot,
        a correction over the limit in all of the measured region),
        DeviceFault, DeviceLost.
        """

    def replace_correction_model(self, model: CorrectionModel) -> None:
        """From now on correct by another model; the correction goes there within its limits. Raises DeviceRefused."""

    async def correction_off(self) -> CorrectionReport:
        """Let the correction fade to zero, also during a motion, and end it behind that motion.

        Raises DeviceFault, DeviceLost if it had ended, or does not end.
        """

    def correction_id(self) -> str:
        """The id of the model in force; empty without an on-line correction."""

    async def programmed_joints(self) -> JointReadings:
        """Where its own program has the robot, degrees: actual joints less the correction. Raises as `joints`."""

    def correction_samples(self) -> tuple[CorrectionSample, ...]:
        """The samples since the last call, up to half a second ago."""

    async def run_program(self, number: int, limit_s: float) -> JointReadings:
        """Run the controller's own program `number`; joints at its end. Raises as `move`, and after `limit_s`."""
