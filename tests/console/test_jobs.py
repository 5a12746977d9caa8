"""Jobs of the console: started, followed, cancelled, bounded in number, and not ended with the console."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, TypeVar

from cellctl.console.jobs import Job, Jobs
from cellctl.files import Problem
from tests.helpers import job_worker

T = TypeVar("T")


def run(work: Callable[[Jobs], Awaitable[T]], at_once: int = 2) -> T:
    """`work` with jobs of the test's own operations."""

    async def go() -> T:
        jobs = Jobs(job_worker.COMMAND, at_once)
        try:
            return await work(jobs)
        finally:
            await jobs.close()

    return asyncio.run(go())


def ended(operation: str, request: dict[str, Any]) -> Job:
    """A job that ran to its end."""
    return run(lambda jobs: jobs.start("a job", operation, request, "Ada").ended())


async def until(job: Job, condition: Callable[[], bool]) -> None:
    """Wait for a change of the job that fulfils the condition."""
    changed = asyncio.Event()
    job.subscribe(changed.set)
    while not condition():
        await changed.wait()
        changed.clear()


def test_a_job_gives_its_result_and_all_of_its_progress() -> None:
    async def work(jobs: Jobs) -> tuple[Job, list[str]]:
        seen: list[str] = []
        job = jobs.start("count", "count", {"to": 3}, "Ada")
        job.subscribe(lambda: seen.append(job.doing))
        return await job.ended(), seen

    job, seen = run(work)
    assert (job.state, job.result["counted"], job.share, job.failure) == ("done", 3, 1.0, None)
    assert {"number 0", "number 1", "number 2"} <= set(seen)


def test_jobs_tell_of_each_job_that_is_new_runs_and_has_ended() -> None:
    async def work(jobs: Jobs) -> list[tuple[str, str]]:
        told: list[tuple[str, str]] = []
        jobs.subscribe(lambda job: told.append((job.target, job.state)))
        await jobs.start("count", "count", {"to": 1}, "Ada", target="data").ended()
        return told

    assert run(work) == [("data", "waiting"), ("data", "running"), ("data", "done")]


def test_what_an_operation_prints_is_kept_as_lines_and_does_not_disturb_the_result() -> None:
    job = ended("count", {"to": 1})
    assert job.state == "done"
    assert {"printed", "warned"} <= set(job.lines)


def test_a_result_of_a_megabyte_arrives() -> None:
    assert len(ended("count", {"to": 1, "letters": 1_000_000}).result["letters"]) == 1_000_000


def test_wrong_input_fails_with_exit_code_place_and_cure() -> None:
    job = ended("refuse", {"file": "data.csv"})
    assert job.state == "failed"
    assert job.failure is not None
    assert job.failure.code == 2
    assert job.failure.problems == (Problem("data.csv", 7, 0, "is wrong", "correct it"),)


def test_an_error_of_the_program_is_a_failure_without_a_traceback() -> None:
    job = ended("break_down", {})
    assert job.failure is not None
    assert job.failure.code == 3
    assert "internal error: KeyError" in str(job.failure)
    assert not any("Traceback" in line for line in job.lines)


def test_a_process_that_cannot_start_is_a_failure() -> None:
    async def work(_: Jobs) -> Job:
        return await Jobs(("/nowhere/python",)).start("a job", "count", {}, "Ada").ended()

    job = run(work)
    assert job.state == "failed"
    assert job.failure is not None
    assert "/nowhere/python" in str(job.failure)


def test_a_cancelled_job_cleans_up_and_ends(tmp_path: Path) -> None:
    async def work(jobs: Jobs) -> Job:
        job = jobs.start("wait", "wait_for_ever", {"cleaned": str(tmp_path / "cleaned")}, "Ada")
        await until(job, lambda: job.doing == "waiting")
        job.cancel()
        return await job.ended()

    assert run(work).state == "cancelled"
    assert (tmp_path / "cleaned").read_text() == "yes"


def test_computing_jobs_wait_for_a_processor_and_others_do_not(tmp_path: Path) -> None:
    async def work(jobs: Jobs) -> tuple[str, str, str, str]:
        first = jobs.start("first", "wait_for_ever", {"cleaned": str(tmp_path / "cleaned")}, "Ada")
        await until(first, lambda: first.doing == "waiting")
        second = jobs.start("second", "count", {"to": 1}, "Ada")
        third = jobs.start("third", "count", {"to": 1}, "Ada")
        third.cancel()
        device = await jobs.start("doctor", "count", {"to": 1}, "Ada", computes=False).ended()
        before = second.state
        first.cancel()
        await second.ended()
        return before, second.state, device.state, third.state

    assert run(work, at_once=1) == ("waiting", "done", "done", "cancelled")


def test_a_job_goes_on_when_the_console_has_ended(tmp_path: Path) -> None:
    async def work(jobs: Jobs) -> None:
        request = {"go": str(tmp_path / "go"), "done": str(tmp_path / "done")}
        job = jobs.start("later", "write_later", request, "Ada")
        await until(job, lambda: job.doing == "ready")

    async def wait() -> None:
        async with asyncio.timeout(20):
            while not (tmp_path / "done").exists():
                await asyncio.sleep(0.02)

    run(work)
    (tmp_path / "go").write_text("")
    asyncio.run(wait())
