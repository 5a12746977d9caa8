"""The runner: connects, does the steps one after another, cleans up whatever happened, and keeps the journal."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AbstractAsyncContextManager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, final

from cellctl.clock import Clock
from cellctl.devices import Device, DeviceError, DeviceUncertain, DeviceUnreachable, Identity, SearchingRobot
from cellctl.engine.context import AfterConnect, Context, Surround
from cellctl.engine.mailbox import Mailbox
from cellctl.engine.outcome import Outcome
from cellctl.engine.states import State, checked
from cellctl.engine.watcher import NobodyWatching, Watcher
from cellctl.journal import (
    DevicesConnected,
    Journal,
    JournalError,
    KnownEvent,
    RunEnded,
    RunState,
    Said,
    StateChanged,
    StepEnded,
    StepFailure,
    StepStarted,
)
from cellctl.journal import Outcome as StepOutcome
from cellctl.procedure import (
    Action,
    AnyStepKind,
    Loop,
    OnResume,
    Procedure,
    Step,
    StepRegistry,
    inputs_of,
    resolve,
    step_path,
)
from cellctl.records import VerdictRow

_STOP_SECONDS = 10.0
"""How long one device may take to come to its safe state, in the cell's time."""

_CLOSE_WALL_SECONDS = 30.0
"""How long letting go of a device may take. Wall time: ports and processes of this host know no other."""

_CLEANUP_SECONDS = 30.0
"""How long a clean-up step may take that does not say so itself."""


class Aborted(Exception):
    """The operator ended the run, or what started it is gone; the text says which."""


@final
@dataclass(slots=True)
class Plan:
    """What to run: the procedure with its parameters' values, the kinds of steps, and the devices by name."""

    procedure: Procedure
    parameters: Mapping[str, Any]
    registry: StepRegistry
    devices: dict[str, Device]


@final
class Engine:
    """Runs one procedure once, or goes on with it: `record` is what its journal holds already.

    Steps that are done in `record` are not done again, unless they say `on_resume: always`.
    """

    def __init__(
        self,
        plan: Plan,
        run: Surround,
        journal: Journal,
        mailbox: Mailbox,
        watcher: Watcher | None = None,
        record: RunState | None = None,
    ) -> None:
        self._plan = plan
        self._run = run
        self._journal = journal
        self._mailbox = mailbox
        self._watcher = watcher or NobodyWatching()
        self._clock: Clock = run.clock
        self._connected: list[Device] = []
        self._answered: set[str] = set()
        self._stopped: set[str] = set()
        self._moved = False
        self._record = record or RunState()
        self._done = dict(self._record.finished)
        self._journal_error: JournalError | None = None
        self.state = State.IDLE

    async def run(self, after_connect: AfterConnect | None = None) -> Outcome:
        """Connect, run the steps, clean up. Never raises: what went wrong is in the outcome.

        `after_connect` is awaited once every device answers, before the first step.
        """
        began = self._clock.now()
        self._enter(State.CHECKING, "")
        work = asyncio.create_task(self._work(after_connect), name="campaign")
        self._mailbox.when_aborted(work.cancel)
        error = await _end_of(work)
        self._mailbox.when_aborted(None)
        if self._mailbox.aborted and isinstance(error, asyncio.CancelledError):
            error = Aborted(self._mailbox.why_aborted)
        troubles = await _shielded(self._clean_up(error))
        end = self._end_state(error, troubles)
        self._enter(end, "; ".join([*([str(error)] if error else []), *troubles]))
        verdict = self._record.last(VerdictRow)
        self._append(RunEnded(end.value, verdict.verdict if verdict else "", str(error or "")))
        seconds = self._clock.now() - began
        error = error or self._journal_error
        return Outcome(end, error, tuple(troubles), verdict, seconds, self._moved, self._held())

    async def _work(self, after_connect: AfterConnect | None) -> None:
        self._enter(State.CONNECTING, "")
        identities = await self._connect()
        self._append(DevicesConnected({i.device: asdict(i) for i in identities}))
        for device in self._connected:
            self._said("", f"{device.name}: {(await device.health()).text}")
        if after_connect:
            await after_connect()
        self._enter(State.RUNNING, "")
        await self._actions(self._plan.procedure.steps, dict(self._plan.parameters), "")

    async def _connect(self) -> tuple[Identity, ...]:
        """Connect all devices at once; one error names every one that failed."""
        devices = list(self._plan.devices.values())
        self._connected = devices
        results = await asyncio.gather(*(device.connect() for device in devices), return_exceptions=True)
        pairs = zip(devices, results, strict=True)
        self._answered = {device.name for device, result in pairs if isinstance(result, Identity)}
        failed = [result for result in results if isinstance(result, BaseException)]
        for failure in failed:
            if not isinstance(failure, DeviceError):
                raise failure
        if len(failed) == 1:
            raise failed[0]
        if failed:
            raise DeviceUnreachable("cell", "devices do not answer:\n" + "\n".join(str(f) for f in failed))
        return tuple(result for result in results if isinstance(result, Identity))

    async def _actions(self, actions: tuple[Action, ...], scope: dict[str, Any], outer: str) -> None:
        for action in actions:
            if isinstance(action, Step):
                scope[action.id] = await self._step(action, scope, step_path(outer, action.id))
            else:
                await self._loop(action, scope, outer)

    async def _loop(self, loop: Loop, scope: dict[str, Any], outer: str) -> None:
        values = resolve(loop.for_each, scope)
        path = step_path(outer, loop.id)
        for index, value in enumerate(values):
            self._show(partial(_pass_begins, path, index, len(values)))
            inner = {**scope, loop.variable: value}
            await self._actions(loop.steps, inner, step_path(outer, loop.id, index))
        self._show(partial(_pass_begins, path, len(values), len(values)))

    async def _step(self, step: Step, scope: Mapping[str, Any], path: str) -> dict[str, Any] | None:
        """Do one step, with its retries; or take its result where it is done. Raises what its last attempt raised."""
        if path in self._done and step.on_resume is OnResume.SKIP:
            result: dict[str, Any] | None = self._done[path]
            return result
        await self._at_border()
        kind = self._plan.registry.find(step.do)
        inputs = inputs_of(self._plan.procedure, step, kind, scope)
        self._moved = self._moved or kind.moves
        retryable = tuple(kind.retryable()[name] for name in step.retry.on)
        for tried in range(1, step.retry.attempts + 1):
            try:
                return await self._attempt(kind, inputs, step, path)
            except retryable as error:
                if tried == step.retry.attempts:
                    raise
                self._said(path, f"attempt {tried} of {step.retry.attempts} failed, trying again: {error}")
        raise AssertionError("a step is tried at least once")

    async def _attempt(
        self, kind: AnyStepKind, inputs: Any, step: Step, path: str, limit: float | None = None
    ) -> dict[str, Any] | None:
        attempt = self._record.next_attempt(path)
        context = Context(
            step=path,
            attempt=attempt,
            run=self._run,
            needs=frozenset(kind.needs),
            journal=self._record,
            append=self._append,
        )
        self._append(StepStarted(path, attempt, kind.moves, step.do))
        try:
            async with self._clock.timeout(step.timeout_s or limit):
                result = kind.dump_result(await kind(context, inputs))
        except BaseException as error:
            self._append(_failed(path, attempt, error), final=True)
            if isinstance(error, TimeoutError) and not str(error):
                raise TimeoutError(f"{path}: not done within {step.timeout_s or limit:g} s") from error
            raise
        self._append(StepEnded(path, attempt, StepOutcome.DONE, result))
        return result

    async def _at_border(self) -> None:
        if self._mailbox.paused:
            self._enter(State.PAUSED, "by the operator")
            await self._mailbox.may_run()
            self._enter(State.RUNNING, "by the operator")

    async def _clean_up(self, error: BaseException | None) -> list[str]:
        """Try every clean-up step and stop and close every device; what failed, in words."""
        self._enter(State.CLEANING, str(error) if error else "")
        troubles: list[str] = []
        reached = self._run.devices.keys() if self._connected else set()
        for step in self._plan.procedure.cleanup:
            if isinstance(step, Step) and self._plan.registry.find(step.do).needs.keys() <= reached:
                troubles += await self._clean_step(step)
        for device in self._connected:
            safe = f"{device.name} could not be brought to its safe state"
            failed = await _tried(device.stop, self._clock.timeout(_STOP_SECONDS), safe)
            troubles += failed
            if not failed:
                self._stopped.add(device.name)
            free = f"{device.name} could not be let go of"
            troubles += await _tried(device.close, asyncio.timeout(_CLOSE_WALL_SECONDS), free)
        return list(dict.fromkeys(troubles))

    async def _clean_step(self, step: Step) -> list[str]:
        path = step_path("cleanup", step.id)
        try:
            kind = self._plan.registry.find(step.do)
            inputs = inputs_of(self._plan.procedure, step, kind, self._plan.parameters)
            await self._attempt(kind, inputs, step, path, _CLEANUP_SECONDS)
        except Exception as failure:
            return [f"clean-up step '{step.id}' failed: {failure}"]
        return []

    def _held(self) -> bool:
        """Whether every robot of the cell answered, and confirmed in the clean-up that it stands still."""
        robots = {device.name for device in self._plan.devices.values() if isinstance(device, SearchingRobot)}
        return bool(robots) and robots <= self._answered & self._stopped

    def _end_state(self, error: BaseException | None, troubles: list[str]) -> State:
        if troubles or isinstance(error, DeviceUncertain):
            return State.UNCERTAIN
        if isinstance(error, Aborted):
            return State.ABORTED
        return State.FAILED if error or self._journal_error else State.FINISHED

    def _enter(self, state: State, reason: str) -> None:
        before, self.state = self.state, checked(self.state, state)
        self._append(StateChanged(before.value, state.value, reason), final=state != State.RUNNING)

    def _show(self, tell: Callable[[Watcher], None]) -> None:
        """Tell who looks on. A display that fails (its terminal is gone) is not asked again, and ends no campaign."""
        try:
            tell(self._watcher)
        except Exception:
            self._watcher = NobodyWatching()

    def _said(self, path: str, text: str) -> None:
        self._append(Said(text, path))

    def _append(self, event: KnownEvent, *, final: bool = False) -> None:
        """Commit an event. A journal that cannot be written ends the run: nothing more is done that it would not hold.

        With `final`, or once that has happened, the failure is kept for the outcome instead of raised.
        """
        if self._journal_error is None:
            try:
                self._record.apply(self._journal.append(event))
            except JournalError as error:
                self._journal_error = error
                if not final:
                    raise
        self._show(lambda watcher: watcher.event(event))


def _failed(path: str, attempt: int, error: BaseException) -> StepEnded:
    outcomes = {asyncio.CancelledError: StepOutcome.CANCELLED, TimeoutError: StepOutcome.TIMED_OUT}
    failure = StepFailure(type(error).__name__, str(error), getattr(error, "cure", ""))
    return StepEnded(path, attempt, outcomes.get(type(error), StepOutcome.FAILED), None, failure)


async def _tried(
    action: Callable[[], Awaitable[None]], bound: AbstractAsyncContextManager[object], otherwise: str
) -> list[str]:
    """Do one action of the clean-up within `bound`; what came of it where it failed, begun by `otherwise`."""
    try:
        async with bound:
            await action()
    except Exception as failure:
        return [f"{otherwise}: {str(failure) or type(failure).__name__}"]
    return []


def _pass_begins(path: str, index: int, count: int, watcher: Watcher) -> None:
    watcher.loop(path, index, count)


async def _end_of(task: asyncio.Task[None]) -> BaseException | None:
    """Wait for `task`, whatever it raises; cancelling the waiter cancels it and waits on."""
    while True:
        try:
            await asyncio.shield(task)
        except BaseException as error:
            if task.done():
                return error
            task.cancel()
        else:
            return None


async def _shielded(work: Any) -> list[str]:
    """Run `work` to its end, whatever cancels the waiter."""
    task: asyncio.Task[list[str]] = asyncio.ensure_future(work)
    while not task.done():
        with suppress(asyncio.CancelledError):
            await asyncio.shield(task)
    return task.result()
