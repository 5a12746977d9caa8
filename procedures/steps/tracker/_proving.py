"""A model identified or of an earlier run, proved on held-out poses: by a table, or by on-line correction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.devices import (
    CellReadings,
    CorrectingRobot,
    CorrectionModel,
    CurrentSource,
    DeviceRefused,
    JointReadings,
    PointSource,
    TableStore,
)
from cellctl.procedure import CellContext, NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.identified import write_and_record
from procedures.steps.judged import Judged, Pushed, PushInputs
from procedures.steps.table_push import push_unless_judged, take_back_unproved, withdrawn_unless_better
from procedures.steps.tracker._verdict import verdict_of
from procedures.steps.tracker.identification import identify_poses, registered_model
from procedures.steps.tracker.measuring import NEAR_SHARE, Measured, MeasureInputs, NotSettled, measure_pose
from procedures.steps.tracker.model_files import check_model, correction_file, read_model_of
from procedures.steps.tracker.plan_inputs import DEFAULT_METHOD
from procedures.steps.tracker.pose_plans import ModelInputs, Round, check_method
from procedures.steps.tracker.rows import (
    CORRECTION_FILE,
    MODEL_FILE,
    CorrectionEndRow,
    CorrectionLogRow,
    CorrectionModelRow,
    ReadModelRow,
    TrackerVerdict,
)
from procedures.steps.tracker.target_table import compensated_rounds


class IdentifyInputs(ModelInputs):
    """goal_mm: of the campaign, 0: none."""

    goal_mm: Annotated[float, Field(ge=0)] = 0.0


@step("tracker.identify", verdict=TrackerVerdict)
async def identify(context: StepContext, inputs: IdentifyInputs) -> Judged:
    """Identify the robot from the poses, state how good it was and is on the held-out ones, write data and model."""
    return await write_and_record(
        context, await context.clock.compute(identify_poses, context, inputs.model, inputs.goal_mm)
    )


class ReadModelInputs(StepInputs):
    """run: folder of the run whose model compensates, or its name beside this run. file: a model file. Both empty: none
    is read.
    """

    run: str = ""
    file: str = ""


class ReadModel(StepResult):
    """Whether a model was read."""

    found: bool


def _check_model(context: CellContext, known: Mapping[str, Any]) -> None:
    check_model(context, known, of_reflector=True)


@step("tracker.read_model", check=_check_model, reads_files=True)
async def read_model(context: StepContext, inputs: ReadModelInputs) -> ReadModel:
    """Read the model of an earlier run, if one is named; refuse that of another controller, robot or tool."""
    named = bool(inputs.run or inputs.file)
    if named:
        row = await context.clock.compute(read_model_of, context, inputs.run, inputs.file, True)
        await context.record(row)
        await context.write_artefact(MODEL_FILE, row.text)
    else:
        context.say("no model is named: one is identified first")
    return ReadModel(found=named)


@step("tracker.register", verdict=TrackerVerdict)
async def register(context: StepContext, inputs: NoInputs) -> Judged:
    """Find the instrument in the frame of the model that was read, and judge that model on the held-out poses."""
    await context.write_artefact(MODEL_FILE, context.recorded(ReadModelRow)[-1].text)
    return await write_and_record(context, await context.clock.compute(registered_model, context))


class CompensateInputs(StepInputs):
    """monuments_every: targets between two visits to the monuments. method: one of `cellctl.compensation.METHODS`.

    passes: of the method; 0: until it converges. online: the targets are corrected on-line, within that limit, and the
    table is their record.
    """

    monuments_every: Annotated[int, Field(ge=5)] = 30
    method: str = DEFAULT_METHOD
    passes: Annotated[int, Field(ge=0)] = 0
    online: bool = False


class Compensation(StepResult):
    """The targets, in rounds; the id of the table in the run folder. Empty if the model is no better than nominal."""

    rounds: list[Round]
    table: str | None


@step("tracker.compensate", check=check_method)
async def compensate(context: StepContext, inputs: CompensateInputs) -> Compensation:
    """Compensate the held-out poses and write their table into the run folder, if the model is better than nominal."""
    if not context.recorded(TrackerVerdict)[-1].better:
        context.say("the model is no better than nominal on held-out poses: nothing is compensated or pushed")
        return Compensation(rounds=[], table=None)
    found = await context.clock.compute(compensated_rounds, context, inputs)
    await context.write_artefact("table.json", found.table)
    await context.record(found.row)
    context.say(found.sentence)
    return Compensation(rounds=found.rounds, table=found.row.table)


@step("tracker.push", needs={"robot": TableStore})
async def push(context: StepContext, inputs: PushInputs) -> Pushed:
    """Push the run's table to the controller: refused where it does not fit, read back, in force at once.

    In a procedure whose clean-up withdraws it this step is to be done again on resume (`on_resume: always`).
    """
    judged = [verdict for verdict in context.recorded(TrackerVerdict) if verdict.targets]
    return Pushed(active=await push_unless_judged(context, inputs.table, judged))


@step("tracker.judge", needs={"robot": TableStore}, verdict=TrackerVerdict)
async def judge(context: StepContext, inputs: NoInputs) -> Judged:
    """State how good the robot was and is on the held-out targets; withdraw a table that is not better."""
    found, errors = await context.clock.compute(verdict_of, context)
    if errors:
        await context.record(errors)
    found = await withdrawn_unless_better(context, found)
    await context.record(found)
    return Judged.of(found)


@step("tracker.withdraw", needs={"robot": TableStore})
async def withdraw(context: StepContext, inputs: NoInputs) -> None:
    """For the clean-up: take the run's table out of force where the run ended before it was proved."""
    await take_back_unproved(context, context.device("robot"))


class CorrectInputs(StepInputs):
    """table: id of the table with the targets' predictions; None: the model is no better than nominal."""

    table: str | None


class Correction(StepResult):
    """The id of the correction model in force, None without one."""

    id: str | None


@step("tracker.correction_on", needs={"robot": CorrectingRobot}, uses={"plc": CellReadings})
async def correction_on(context: StepContext, inputs: CorrectInputs) -> Correction:
    """Write the correction model of the run's model, and correct the controller's motions by it from now on."""
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


@step("tracker.correction_off", needs={"robot": CorrectingRobot})
async def correction_off(context: StepContext, inputs: NoInputs) -> None:
    """Let the correction fade to zero, switch RSI off, and record what it did."""
    robot: CorrectingRobot = context.device("robot")
    if not robot.correction_id():
        return
    row = CorrectionEndRow.of(await robot.correction_off())
    await context.record(row)
    context.say(row.sentence)


@step("tracker.judge_correction", verdict=TrackerVerdict)
async def judge_correction(context: StepContext, inputs: NoInputs) -> Judged:
    """State how good the robot was and is on the held-out targets."""
    found, errors = await context.clock.compute(verdict_of, context, "Corrected on-line")
    if errors:
        await context.record(errors)
    await context.record(found)
    return Judged.of(found)
