"""Proves on-line correction on held-out targets: on, each target by its nominal joints, off, judged."""

from __future__ import annotations

from cellctl.devices import (
    CellReadings,
    CorrectingRobot,
    CorrectionModel,
    CurrentSource,
    DeviceRefused,
    JointReadings,
    PointSource,
)
from cellctl.procedure import NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.judged import Judged
from procedures.steps.tracker.measuring import NEAR_SHARE, Measured, MeasureInputs, measure_pose
from procedures.steps.tracker.pointing import NotSettled
from procedures.steps.tracker.rows import (
    CORRECTION_FILE,
    CorrectionEndRow,
    CorrectionLogRow,
    CorrectionModelRow,
    TrackerVerdict,
)


class CorrectInputs(StepInputs):
    """table: id of the table with the targets' predictions; None: the model is no better than nominal."""

    table: str | None


class Correction(StepResult):
    """The id of the correction model in force, None without one."""

    id: str | None


@step(
    "tracker.correction_on",
    needs={"robot": CorrectingRobot},
    uses={"plc": CellReadings},
    title="switching the on-line correction on",
)
async def correction_on(context: StepContext, inputs: CorrectInputs) -> Correction:
    """Write the correction model of the run's model, and correct the controller's motions by it from now on."""
    from procedures.steps.tracker.correction_file import correction_file

    if inputs.table is None:
        return Correction(id=None)
    plc: CellReadings | None = context.optional_device("plc")
    arm_c = (await plc.temperatures()).arm if plc else None
    robot: CorrectingRobot = context.device("robot")
    file = await context.clock.compute(correction_file, context, arm_c)
    if robot.correction_id() == file.id:
        return Correction(id=file.id)
    await context.write_artefact(CORRECTION_FILE, file.text())
    await context.record(CorrectionModelRow(id=file.id, arm_c=arm_c, left_out=tuple(file.left_out)))
    arrays = {name: tuple(values) for name, values in file.arrays.items()}
    await robot.correction_on(CorrectionModel(file.id, arrays))
    context.say(f"on-line correction {file.id[:12]} is on" + "".join(f"; without {each}" for each in file.left_out))
    return Correction(id=file.id)


@step(
    "tracker.measure_corrected",
    needs={"robot": CorrectingRobot, "tracker": PointSource},
    uses={"plc": CellReadings, "drives": CurrentSource},
    errors=(NotSettled,),
    title="measuring corrected targets",
)
async def measure_corrected(context: StepContext, inputs: MeasureInputs) -> Measured:
    """Go to a target by its nominal joints and its approach, corrected on-line, and measure the reflector."""
    robot: CorrectingRobot = context.device("robot")
    wanted = context.recorded(CorrectionModelRow)[-1].id

    async def to_target() -> JointReadings:
        if robot.correction_id() != wanted:
            cure = "Resume the run: its correction is switched on again."
            raise DeviceRefused("robot", f"on-line correction {wanted[:12]} of this run is not on", cure)
        return await robot.move(tuple(inputs.pose.joints), inputs.transfer_percent * NEAR_SHARE)

    found = await measure_pose(context, inputs, to_target, await robot.programmed_joints())
    await context.record(CorrectionLogRow.of(robot.correction_samples()))
    return found


@step(
    "tracker.correction_off",
    needs={"robot": CorrectingRobot},
    title="switching the on-line correction off",
)
async def correction_off(context: StepContext, inputs: NoInputs) -> None:
    """Let the correction fade to zero, switch RSI off, and record what it did."""
    robot: CorrectingRobot = context.device("robot")
    if not robot.correction_id():
        return
    row = CorrectionEndRow.of(await robot.correction_off())
    await context.record(row)
    context.say(row.sentence)


@step("tracker.judge_correction", verdict=TrackerVerdict, title="judging the on-line correction")
async def judge_correction(context: StepContext, inputs: NoInputs) -> Judged:
    """State how good the robot was and is on the held-out targets."""
    from procedures.steps.tracker.judging import verdict_of

    found, errors = await context.clock.compute(verdict_of, context, "Corrected on-line")
    if errors:
        await context.record(errors)
    await context.record(found)
    return Judged.of(found)
