"""The runner: connects, does the steps one after another, cleans up whatever happened, and keeps the journal."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, final

from cellctl.clock import Clock
from cellctl.devices import Device, DeviceError, DeviceUncertain, DeviceUnreachable, Identity, SearchingRobot
from cellctl.engine.cleaning import CLEANUP_SECONDS, stop_and_close
from cellctl.engine.context import AfterConnect, Context, Surround
from cellctl.engine.control import BY_OPERATOR, Control
from cellctl.engine.interlocks import Interlocks, StoppedByInterlock
from cellctl.engine.mailbox import Mailbox
from cellctl.engine.mailbox_folder import MailboxFolder
from cellctl.engine.outcome import Outcome
from cellctl.engine.recorder import Recorder
from cellctl.engine.states import State, checked
from cellctl.engine.waiting import ended, error_of
from cellctl.engine.watcher import NobodyWatching, Watcher
from cellctl.files import InputError
from cellctl.journal import (
    DevicesConnected,
    Journal,
    RunEnded,
    RunState,
    StateChanged,
    StepEnded,
    StepStarted,
)
from cellctl.journal import Outcome as StepOutcome
from cellctl.procedure import (
    Action,
    AnyStepKind,
    Confirm,
    If,
    Loop,
    OnResume,
    Procedure,
    Step,
    StepRegistry,
    UnresolvedReference,
    inputs_of,
    resolve,
    step_path,
)
from cellctl.records import VerdictRow


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
        self._clock: Clock = run.clock
        self._recorder = Recorder(journal, record or RunState(), watcher or NobodyWatching(), run.clock)
        self._record = self._recorder.state
        self._mailbox = mailbox
        self._control = Control(mailbox, self._recorder)
        self._interlocks = Interlocks(plan.procedure, plan.devices, run.clock, self._control.interlock_changed)
        self._control.interlocks = self._interlocks
        self._connected: list[Device] = []
        self._answered: set[str] = set()
        self._stopped: set[str] = set()
        self._moved = False
        self._done = dict(self._record.finished)
        self.state = State.IDLE

    async def run(self, after_connect: AfterConnect | None = None) -> Outcome:
        """Connect, run the steps, clean up. What went wrong is in the outcome.

        `after_connect` is awaited once every device answers, before the first step. Raises CancelledError, after the
        clean-up and the journal's last event, where the caller was cancelled; nothing else.
        """
        began = self._clock.now()
        self._enter(State.CHECKING, "")
        async with MailboxFolder(self._run.run_folder).emptied_into(self._mailbox):
            self._mailbox.taken_by(self._control.take)
            error, troubles, cancelled = await self._worked(after_connect)
        end = self._end_state(error, troubles)
        self._enter(end, "; ".join([*([str(error)] if error else []), *troubles]))
        verdict = self._record.last(VerdictRow)
        self._recorder.append(RunEnded(end.value, verdict.verdict if verdict else "", str(error or "")))
        self._mailbox.taken_by(lambda _: None)
        seconds = self._clock.now() - began
        if cancelled:
            raise asyncio.CancelledError
        error = error or self._recorder.error
        return Outcome(end, error, tuple(troubles), verdict, seconds, self._moved, self._held())

    async def _worked(self, after_connect: AfterConnect | None) -> tuple[BaseException | None, list[str], bool]:
        """The work and its clean-up: what ended the work, what failed in the clean-up, was the caller cancelled."""
        work = asyncio.create_task(self._work(after_connect), name="campaign")
        self._control.cancel = work.cancel
        if self._control.aborted:
            work.cancel()
        cancelled = await ended(work, on_cancel=work.cancel)
        self._control.ending = True
        error = error_of(work)
        if isinstance(error, asyncio.CancelledError):
            error = Aborted(self._control.aborted or "aborted: the program that runs it was cancelled")
        cleaning = asyncio.create_task(self._clean_up(error), name="clean-up")
        cancelled |= await ended(cleaning)
        return error, cleaning.result(), cancelled

    async def _work(self, after_connect: AfterConnect | None) -> None:
        self._enter(State.CONNECTING, "")
        identities = await self._connect()
        self._recorder.append(DevicesConnected({i.device: asdict(i) for i in identities}))
        for device in self._connected:
            self._recorder.said("", f"{device.name}: {(await device.health()).text}")
        if after_connect:
            await after_connect()
        self._interlocks.install()
        self._enter(State.RUNNING, "")
        await self._interlocks.look()
        watching = asyncio.create_task(self._interlocks.watch(), name="interlocks")
        try:
            await self._actions(self._plan.procedure.steps, dict(self._plan.parameters), "")
        finally:
            watching.cancel()
            with suppress(asyncio.CancelledError):
                await watching

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
            path = step_path(outer, action.id)
            match action:
                case Step():
                    scope[action.id] = await self._step(action, scope, path)
                case Loop():
                    await self._loop(action, scope, outer)
                case If():
                    branch = action.then if self._decided(action, scope, path) else action.otherwise
                    await self._actions(branch, dict(scope), path)
                case Confirm():
                    await self._confirm(action, path)

    async def _loop(self, loop: Loop, scope: dict[str, Any], outer: str) -> None:
        values = resolve(loop.for_each, scope)
        path = step_path(outer, loop.id)
        for index, value in enumerate(values):
            self._recorder.show(partial(_pass_begins, path, index, len(values)))
            inner = {**scope, loop.variable: value}
            await self._actions(loop.steps, inner, step_path(outer, loop.id, index))
        self._recorder.show(partial(_pass_begins, path, len(values), len(values)))

    def _decided(self, action: If, scope: Mapping[str, Any], path: str) -> bool:
        """What the `if` is decided to, once for the whole run: a resumed run takes the branch that it took before."""
        if path in self._done:
            return bool(self._done[path]["value"])
        assert action.expression is not None
        try:
            value = action.expression.value(scope)
        except (UnresolvedReference, ValueError) as error:
            raise InputError(self._plan.procedure.document.problem((*action.at, "if"), str(error))) from error
        attempt = self._record.next_attempt(path)
        self._recorder.append(StepStarted(path, attempt, False, "if"))
        self._recorder.append(StepEnded(path, attempt, StepOutcome.DONE, {"value": value}))
        return value

    async def _confirm(self, action: Confirm, path: str) -> None:
        async def confirmed() -> dict[str, Any]:
            self._recorder.said(path, action.text)
            with self._clock.standing():
                return asdict(await self._control.confirmation())

        if path in self._done and action.on_resume is OnResume.SKIP:
            return
        while True:
            await self._at_border()
            started = StepStarted(path, self._record.next_attempt(path), False, "confirm")
            with suppress(StoppedByInterlock):
                async with self._interlocks.stoppable():
                    await self._recorder.attempt(started, action.timeout_s, confirmed)
                return

    async def _step(self, step: Step, scope: Mapping[str, Any], path: str) -> dict[str, Any] | None:
        """Do one step, with its retries; or take its result where it is done. Raises what its last attempt raised."""
        if path in self._done and step.on_resume is OnResume.SKIP:
            result: dict[str, Any] | None = self._done[path]
            return result
        kind = self._plan.registry.find(step.do)
        inputs = inputs_of(self._plan.procedure, step, kind, scope)
        retryable = tuple(kind.retryable()[name] for name in step.retry.on)
        failed = 0
        while True:
            await self._at_border()
            self._moved = self._moved or kind.moves
            try:
                async with self._interlocks.stoppable():
                    return await self._attempt(kind, inputs, step, path, step.timeout_s)
            except StoppedByInterlock:
                self._recorder.said(path, "stopped by an interlock; it is done again when the run goes on")
            except retryable as error:
                failed += 1
                if failed == step.retry.attempts or isinstance(error, DeviceUncertain):  # a person has to look first
                    raise
                self._recorder.said(path, f"attempt {failed} of {step.retry.attempts} failed, trying again: {error}")

    async def _attempt(
        self, kind: AnyStepKind, inputs: Any, step: Step, path: str, limit: float | None
    ) -> dict[str, Any] | None:
        attempt = self._record.next_attempt(path)
        context = Context(
            step=path,
            attempt=attempt,
            run=self._run,
            needs=frozenset(kind.needs),
            journal=self._record,
            append=self._recorder.append,
        )

        async def done() -> dict[str, Any] | None:
            return kind.dump_result(await kind(context, inputs))

        return await self._recorder.attempt(StepStarted(path, attempt, kind.moves, step.do), limit, done)

    async def _at_border(self) -> None:
        """Between two steps: look at the interlocks, and wait while something keeps the run from going on."""
        await self._interlocks.look()
        if self._control.aborted:
            await asyncio.sleep(0)  # the cancellation arrives here, before the next step begins
        reason = self._control.held_by()
        if not reason:
            return
        self._enter(State.PAUSED, reason)
        while self._control.held_by():
            # Waiting for a person alone, a simulated cell's time stands still; broken interlocks need it to go on.
            with nullcontext() if self._interlocks.broken else self._clock.standing():
                await self._control.change()
            await self._interlocks.look()
        self._enter(State.RUNNING, BY_OPERATOR if reason == BY_OPERATOR else "the interlocks hold again")

    async def _clean_up(self, error: BaseException | None) -> list[str]:
        """Try every clean-up step and stop and close every device; what failed, in words."""
        self._enter(State.CLEANING, str(error) if error else "")
        troubles: list[str] = []
        reached = self._run.devices.keys() if self._connected else set()
        for step in self._plan.procedure.cleanup:
            if self._plan.registry.find(step.do).needs.keys() <= reached:
                troubles += await self._clean_step(step)
        troubles += await stop_and_close(self._connected, self._clock, self._stopped)
        return list(dict.fromkeys(troubles))

    async def _clean_step(self, step: Step) -> list[str]:
        path = step_path("cleanup", step.id)
        try:
            kind = self._plan.registry.find(step.do)
            inputs = inputs_of(self._plan.procedure, step, kind, self._plan.parameters)
            await self._attempt(kind, inputs, step, path, step.timeout_s or CLEANUP_SECONDS)
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
        return State.FAILED if error or self._recorder.error else State.FINISHED

    def _enter(self, state: State, reason: str) -> None:
        before, self.state = self.state, checked(self.state, state)
        self._recorder.append(StateChanged(before.value, state.value, reason), final=state != State.RUNNING)


def _pass_begins(path: str, index: int, count: int, watcher: Watcher) -> None:
    watcher.loop(path, index, count)
