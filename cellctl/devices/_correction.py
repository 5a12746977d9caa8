"""On-line correction: a robot whose controller runs its own program is corrected by a model in every cycle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from cellctl.devices._protocols import JointReadings, MovingRobot


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
