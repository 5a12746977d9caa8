"""Commands that a process of their own carries out: the audit log has the outcome of the process."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from cellctl.console.jobs import Job
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.operations.failure import Failure

_tasks: set[asyncio.Task[None]] = set()


async def command_job(operator: Operator, name: str, target: str, start: Callable[[], Job], **details: Any) -> Job:
    """Give the command `name` for `target`: `start` starts its job, which is returned as soon as it runs.

    Raises what `start` raises. The command ends in the audit log when the job ends.
    """
    started: asyncio.Future[Job] = asyncio.get_running_loop().create_future()

    async def work() -> None:
        job = start()
        started.set_result(job)
        await result_of(job)

    task = asyncio.create_task(console().command(operator, name, target, work, **details))
    _tasks.add(task)
    task.add_done_callback(_forget)
    await asyncio.wait((task, started), return_when=asyncio.FIRST_COMPLETED)
    if not started.done():
        await task
    return started.result()


async def result_of(job: Job) -> Any:
    """The result of `job`, at its end. Raises InputError if it failed, with its problems, or was cancelled."""
    await job.ended()
    if job.state == "done":
        return job.result
    if job.state == "cancelled":
        raise InputError(Problem(job.title, 0, 0, "was cancelled", "try again"))
    failure = job.failure or Failure.internal(job.state)
    raise InputError(failure.problems, failure.note)


async def all_audited() -> None:
    """Wait until every command given so far has ended, and the audit log has its outcome."""
    await asyncio.gather(*_tasks, return_exceptions=True)


def _forget(task: asyncio.Task[None]) -> None:
    """Drop an ended task; its error is in the audit log, and in the job."""
    _tasks.discard(task)
    if not task.cancelled():
        task.exception()
