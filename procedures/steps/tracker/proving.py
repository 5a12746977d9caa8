"""Proves a model on held-out poses: compensate them, push the table, measure them again, judge."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cellctl.devices import TableStore
from cellctl.procedure import NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.judged import Judged
from procedures.steps.pushing import Pushed, PushInputs
from procedures.steps.tracker.methods import DEFAULT_METHOD, check_method
from procedures.steps.tracker.plans import Round
from procedures.steps.tracker.rows import TrackerVerdict


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


@step("tracker.compensate", check=check_method, title="compensating targets")
async def compensate(context: StepContext, inputs: CompensateInputs) -> Compensation:
    """Compensate the held-out poses and write their table into the run folder, if the model is better than nominal."""
    from procedures.steps.tracker.target_table import compensated_rounds

    if not context.recorded(TrackerVerdict)[-1].better:
        context.say("the model is no better than nominal on held-out poses: nothing is compensated or pushed")
        return Compensation(rounds=[], table=None)
    found = await context.clock.compute(compensated_rounds, context, inputs)
    await context.write_artefact("table.json", found.table)
    await context.record(found.row)
    context.say(found.sentence)
    return Compensation(rounds=found.rounds, table=found.row.table)


@step("tracker.push", needs={"robot": TableStore}, title="pushing the table")
async def push(context: StepContext, inputs: PushInputs) -> Pushed:
    """Push the run's table to the controller: refused where it does not fit, read back, in force at once.

    In a procedure whose clean-up withdraws it this step is to be done again on resume (`on_resume: always`).
    """
    from procedures.steps.table_push import push_unless_judged

    judged = [verdict for verdict in context.recorded(TrackerVerdict) if verdict.targets]
    return Pushed(active=await push_unless_judged(context, inputs.table, judged))


@step("tracker.judge", needs={"robot": TableStore}, verdict=TrackerVerdict, title="judging the table")
async def judge(context: StepContext, inputs: NoInputs) -> Judged:
    """State how good the robot was and is on the held-out targets; withdraw a table that is not better."""
    from procedures.steps.table_push import withdrawn_unless_better
    from procedures.steps.tracker.judging import verdict_of

    found, errors = await context.clock.compute(verdict_of, context)
    if errors:
        await context.record(errors)
    found = await withdrawn_unless_better(context, found)
    await context.record(found)
    return Judged.of(found)


@step("tracker.withdraw", needs={"robot": TableStore})
async def withdraw(context: StepContext, inputs: NoInputs) -> None:
    """For the clean-up: take the run's table out of force where the run ended before it was proved."""
    from procedures.steps.table_push import take_back_unproved

    await take_back_unproved(context, context.device("robot"))
