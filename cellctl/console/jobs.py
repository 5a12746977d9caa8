"""Jobs: processes that the console starts and follows. A job lives on when the console ends."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import tempfile
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any, Literal, TypeAlias, final

from cellctl.clock import calendar_time
from cellctl.operations.pace import time_left
from cellctl.operations.results import ABORTED, Failure, as_json, from_json
from cellctl.operations.worker import WORKER

State: TypeAlias = Literal["waiting", "running", "done", "failed", "cancelled"]

AT_ONCE = 2
"""Computing jobs at once; others wait."""

LOOK_S = 1.0
"""Between two looks at a process of an earlier console."""

KEPT_LINES = 500
KEPT_JOBS = 100
_LONGEST_LINE = 64 * 2**20
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@final
@dataclass(frozen=True, slots=True)
class Adopted:
    """A process that an earlier console started. alive: whether it runs; result: what it left, once it has ended."""

    pid: int
    alive: Callable[[], bool]
    result: Callable[[], Any]

    def terminate(self) -> None:
        """Ask it to end, if it still runs."""
        if self.alive():
            os.kill(self.pid, signal.SIGTERM)


@final
class Job:
    """One process, or what it left. doing, share: its latest progress, share from 0 to 1; time_left: in
    words. lines: its latest output.

    target: what it is for (a run, a cell, an analysis). result: the operation's JSON once it is done; failure: why it
    is not. Belongs to the event loop.
    """

    def __init__(self, number: str, title: str, operation: str, operator: str, target: str = "") -> None:
        self.id, self.title, self.operation, self.operator = number, title, operation, operator
        self.target = target
        self.began = calendar_time()
        self.state: State = "waiting"
        self.doing, self.share, self.time_left = "", 0.0, ""
        self._running_since = 0.0
        self.lines: deque[str] = deque(maxlen=KEPT_LINES)
        self.result: Any = None
        self.failure: Failure | None = None
        self._end = asyncio.Event()
        self._cancelled = False
        self._process: subprocess.Popen[bytes] | Adopted | None = None
        self._callbacks: list[Callable[[], None]] = []
        self._on_state: Callable[[Job], None] = lambda _: None

    @property
    def ended_already(self) -> bool:
        """Whether the job is done, failed or cancelled."""
        return self._end.is_set()

    async def ended(self) -> Job:
        """Wait until the job is done, failed or cancelled."""
        await self._end.wait()
        return self

    def cancel(self) -> None:
        """Ask the process to end; it cleans up first. A job that has ended stays as it is."""
        if self.ended_already:
            return
        self._cancelled = True
        self._signal()
        if self.state == "waiting":
            self._ended("cancelled")

    def subscribe(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Call `callback` after each change, in the event loop; returns what ends that. It must not block."""
        self._callbacks.append(callback)
        return lambda: self._callbacks.remove(callback) if callback in self._callbacks else None

    def to_json(self) -> dict[str, Any]:
        """All about the job, for the API."""
        return {
            "id": self.id,
            "title": self.title,
            "operation": self.operation,
            "target": self.target,
            "operator": self.operator,
            "began": self.began,
            "state": self.state,
            "doing": self.doing,
            "share": self.share,
            "time_left": self.time_left,
            "lines": list(self.lines),
            "result": self.result,
            "failure": as_json(self.failure) if self.failure else None,
        }

    async def _follow(self, worker: Sequence[str], request: Mapping[str, Any]) -> None:
        """Run the process to its end. Not by asyncio's own processes: it kills those when the loop is closed."""
        if self.ended_already:
            return
        self._changed("running")
        self._running_since = time.monotonic()
        command = (*worker, self.operation)
        process = await asyncio.to_thread(_started, command, json.dumps(request))
        self._process = process
        if self._cancelled:  # while the process was made
            self._signal()
        assert process.stdout
        assert process.stderr
        await asyncio.gather(self._read(process.stdout), self._read_errors(process.stderr))
        self._finish(await asyncio.to_thread(process.wait))

    async def _watch(self, process: Adopted) -> None:
        """Wait for the end of a process that an earlier console started."""
        self._process = process
        self._changed("running")
        while await asyncio.to_thread(process.alive):
            await asyncio.sleep(LOOK_S)
        self.result = await asyncio.to_thread(process.result)
        self._ended("done")

    def _signal(self) -> None:
        if self._process is not None:
            self._process.terminate()

    async def _read(self, stream: IO[bytes]) -> None:
        async for raw in _lines(stream):
            match json.loads(raw):
                case {"result": result}:
                    self.result, self.share = result, 1.0
                case {"failure": failure}:
                    self.failure = from_json(Failure, failure)
                case {"doing": doing, "share": share}:
                    self.doing, self.share = doing, max(share, self.share)
                    self.time_left = time_left(time.monotonic() - self._running_since, share)
                case {"line": line}:
                    self.lines.append(line)
            self._changed()

    async def _read_errors(self, stream: IO[bytes]) -> None:
        async for raw in _lines(stream):
            self.lines.append(raw.decode(errors="replace").rstrip())
            self._changed()

    def _finish(self, code: int) -> None:
        if self.failure is None and code == 0:
            self._ended("done")
        elif self._cancelled or code == ABORTED:
            self._ended("cancelled")
        else:
            self.failure = self.failure or Failure.internal(f"the process ended with {code}")
            self._ended("failed")

    def _ended(self, state: State) -> None:
        self._end.set()
        self._changed(state)

    def _changed(self, state: State | None = None) -> None:
        self.state = state or self.state
        for callback in tuple(self._callbacks):
            callback()
        if state is not None:
            self._on_state(self)


@final
class Jobs:
    """The jobs of this console, the newest last. worker: command line of the process, without its operation."""

    def __init__(self, worker: Sequence[str] = WORKER, at_once: int = AT_ONCE) -> None:
        self._worker = worker
        self._free = asyncio.Semaphore(at_once)
        self._jobs: dict[str, Job] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._callbacks: list[Callable[[Job], None]] = []
        self._count = 0

    def start(
        self,
        title: str,
        operation: str,
        request: Mapping[str, Any],
        operator: str,
        *,
        target: str = "",
        computes: bool = True,
    ) -> Job:
        """Start an operation of `cellctl.operations.worker.OPERATIONS` with a JSON `request`, in the event loop.

        computes: it may wait until a processor is free. False for one that talks to devices: it starts at once.
        """
        job = self._new(title, operation, operator, target)
        self._do(self._run(job, request, computes))
        return job

    def adopt(self, title: str, operation: str, process: Adopted, operator: str, *, target: str = "") -> Job:
        """Follow a process that an earlier console started."""
        job = self._new(title, operation, operator, target)
        self._do(job._watch(process))
        return job

    def subscribe(self, callback: Callable[[Job], None]) -> Callable[[], None]:
        """Call `callback` with each job that is new, runs or has ended, in the event loop; returns what ends that.

        It must not block.
        """
        self._callbacks.append(callback)
        return lambda: self._callbacks.remove(callback) if callback in self._callbacks else None

    def all(self) -> list[Job]:
        """The jobs, the newest last."""
        return list(self._jobs.values())

    def find(self, number: str) -> Job | None:
        """The job with this id."""
        return self._jobs.get(number)

    def active(self, target: str) -> list[Job]:
        """The jobs for `target` that have not ended."""
        return [job for job in self._jobs.values() if job.target == target and not job.ended_already]

    async def close(self) -> None:
        """Stop following: jobs that run go on without the console; those that wait are not started."""
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _run(self, job: Job, request: Mapping[str, Any], computes: bool) -> None:
        async with self._free if computes else contextlib.nullcontext():
            try:
                await job._follow(self._worker, request)
            except (OSError, ValueError) as error:  # no process can be made, or its output is not ours
                job.failure = Failure.of(error) if isinstance(error, OSError) else Failure.internal(str(error))
                job._ended("failed")

    def _new(self, title: str, operation: str, operator: str, target: str) -> Job:
        self._count += 1
        job = Job(str(self._count), title, operation, operator, target)
        self._jobs[job.id] = job
        self._forget()
        job._on_state = self._state_changed
        self._state_changed(job)
        return job

    def _state_changed(self, job: Job) -> None:
        for callback in tuple(self._callbacks):
            callback(job)

    def _do(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _forget(self) -> None:
        """Forget the oldest jobs that ended."""
        over = len(self._jobs) - KEPT_JOBS
        for job in [each for each in self._jobs.values() if each.ended_already][: max(over, 0)]:
            del self._jobs[job.id]


def _started(command: Sequence[str], request: str) -> subprocess.Popen[bytes]:
    """A process of its own session, with `request` on its stdin."""
    with tempfile.TemporaryFile() as stdin:
        stdin.write(request.encode())
        stdin.seek(0)
        return subprocess.Popen(
            command,
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, **_ONE_THREAD},
        )


async def _lines(stream: IO[bytes]) -> AsyncIterator[bytes]:
    """The lines of a pipe, which is closed when nobody reads them any more."""
    reader = asyncio.StreamReader(limit=_LONGEST_LINE)
    loop = asyncio.get_running_loop()
    transport, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), stream)
    try:
        async for line in reader:
            yield line
    finally:
        transport.close()
