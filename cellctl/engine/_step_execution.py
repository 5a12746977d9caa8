"""Executes the steps of a procedure in order: loops, branches, confirmations, attempts and retries."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext, suppress
from dataclasses import asdict
from functools import partial
from typing import Any, final

from cellctl.clock import Clock
from cellctl.devices import DeviceError, DeviceLost, DeviceUncertain, StoppedUntilCleared
from cellctl.engine._context import Context, Plan, Surround
from cellctl.engine._control import BY_OPERATOR, NOTICED_AFTER_S, Control, Interlocks, StoppedByInterlock
from cellctl.engine._recorder import Recorder, Watcher
from cellctl.engine._run_devices import DeviceReports, stopped_safely
from cellctl.engine._states import State
from cellctl.files import InputError
from cellctl.journal import Outcome as StepOutcome
from cellctl.journal import StepEnded, StepStarted
from cellctl.procedure import (
    Action,
    AnyStepKind,
    Confirm,
    If,
    Loop,
    OnResume,
    Step,
    UnresolvedReference,
    inputs_of,
    resolve,
    step_path,
)

_MAKE_SURE = "Make sure that the robot stands, stop it at the pendant, then look at its line."


@final
class StepExecution:
    """Executes steps and records each attempt. `moved`: a step that moves or writes was begun.

    `enter(state, reason)` changes the run's state: to paused and back.
    """

    def __init__(
        self,
        plan: Plan,
        run: Surround,
        recorder: Recorder,
        control: Control,
        interlocks: Interlocks,
        reports: DeviceReports,
        enter: Callable[[State, str], object],
    ) -> None:
        self.moved = False
        self._to_clear: AnyStepKind | None = None
        self._failure: DeviceError | None = None
        self._plan, self._run, self._recorder = plan, run, recorder
        self._control, self._interlocks, self._reports, self._enter = control, interlocks, reports, enter
        self._clock: Clock = run.clock
        self._record = recorder.state
        self._done = dict(self._record.finished)

    async def actions(self, actions: tuple[Action, ...], scope: dict[str, Any], outer: str) -> None:
        """Do the `actions` inside `outer`; `scope`: parameters, loop variables and results by name."""
        for action in actions:
            path = step_path(outer, action.id)
            match action:
                case Step():
                    scope[action.id] = await self._step(action, scope, path)
                case Loop():
                    await self._loop(action, scope, outer)
                case If():
                    branch = action.then if self._decided(action, scope, path) else action.otherwise
                    await self.actions(branch, dict(scope), path)
                case Confirm():
                    await self._confirm(action, path)

    async def _loop(self, loop: Loop, scope: dict[str, Any], outer: str) -> None:
        values = resolve(loop.for_each, scope)
        path = step_path(outer, loop.id)
        for index, value in enumerate(values):
            self._recorder.show(partial(_pass_begins, path, index, len(values)))
            inner = {**scope, loop.variable: value}
            await self.actions(loop.steps, inner, step_path(outer, loop.id, index))
        self._recorder.show(partial(_pass_begins, path, len(values), len(values)))

    def _decided(self, action: If, scope: Mapping[str, Any], path: str) -> bool:
        """The decision of the `if`, made once for the whole run: a resumed run takes the same branch."""
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
                return asdict(await self._control.confirmation(path))

        if path in self._done and action.on_resume is OnResume.SKIP:
            return
        while True:
            await self._wait_while_held()
            started = StepStarted(path, self._record.next_attempt(path), False, "confirm")
            with suppress(StoppedByInterlock):
                async with self._interlocks.stoppable():
                    await self._recorder.attempt(started, action.timeout_s, confirmed)
                return

    async def _step(self, step: Step, scope: Mapping[str, Any], path: str) -> dict[str, Any] | None:
        """Do one step with its retries, or return its result if done. Raises the error of the last attempt."""
        if path in self._done and step.on_resume is OnResume.SKIP:
            result: dict[str, Any] | None = self._done[path]
            return result
        kind = self._plan.registry.find(step.do)
        inputs = inputs_of(self._plan.procedure, step, kind, scope)
        retryable = tuple(kind.retryable()[name] for name in step.retry.on)
        failed = 0
        while True:
            await self._wait_while_held()
            self._clear_stops()
            self._failure = None
            self.moved = self.moved or kind.moves
            try:
                async with self._interlocks.stoppable():
                    return await self._attempt_or_interlock(kind, inputs, step, path)
            except StoppedByInterlock as stopped:
                await self._stop_devices(kind, stopped)
                if isinstance(self._failure, DeviceUncertain):  # the interlock broke while it was looked at
                    raise self._with_interlocks(self._failure) from stopped
                self._recorder.said(path, "stopped by an interlock; it is done again when the run goes on")
                await self._interlocks.look()
            except retryable as error:
                failed += 1
                if failed == step.retry.attempts or isinstance(error, DeviceUncertain):  # a person checks first
                    raise
                if kind.moves and isinstance(error, TimeoutError | DeviceLost):  # what it commanded may be under way
                    await self._stop_devices(kind, error)
                self._recorder.said(path, f"attempt {failed} of {step.retry.attempts} failed, trying again: {error}")

    async def _stop_devices(self, kind: AnyStepKind, why: Exception) -> None:
        """Stop the devices of a step that an interlock cancelled, or that failed while one broke, or in a motion.

        Raises DeviceUncertain, with all causes, if one does not confirm it: what broke the interlock may have taken the
        device's line with it, and the robot may be moving.
        """
        self._to_clear = kind
        for name in dict.fromkeys((*kind.needs, *kind.uses)):
            device = self._run.devices.get(name)
            if device and (failed := await stopped_safely(device, self._clock)):
                causes = [*failed, *([str(self._failure)] if self._failure else [])]
                raise self._with_interlocks(DeviceUncertain(name, _in_one_line(causes), _MAKE_SURE)) from why

    def _with_interlocks(self, error: DeviceUncertain) -> DeviceUncertain:
        """With the texts of the interlocks that are broken: the same cause may have broken them."""
        broken = [text for text in self._interlocks.broken.values() if text not in error.what]
        return DeviceUncertain(error.device, _in_one_line([error.what, *broken]), error.cure) if broken else error

    def _clear_stops(self) -> None:
        """The run goes on: a stop that was set for the pause would refuse the step that is done again."""
        kind, self._to_clear = self._to_clear, None
        for name in (*kind.needs, *kind.uses) if kind else ():
            device = self._run.devices.get(name)
            if isinstance(device, StoppedUntilCleared):
                device.clear_stop()

    async def _attempt_or_interlock(
        self, kind: AnyStepKind, inputs: Any, step: Step, path: str
    ) -> dict[str, Any] | None:
        """One attempt. Raises StoppedByInterlock if a device failed because an interlock broke."""
        try:
            return await self.attempt(kind, inputs, step, path, step.timeout_s)
        except DeviceUncertain as error:  # a person checks first, and is told what else broke by the same cause
            self._failure = error
            await self._interlocks.look_after_failure()
            raise self._with_interlocks(error) from error.__cause__
        except DeviceError as error:
            self._failure = error
            stopped = await self._interlocks.look_after_failure()
            if self._control.aborted:
                await asyncio.sleep(0)  # the cancellation arrives here
            if stopped:
                raise StoppedByInterlock from error
            raise

    async def attempt(
        self, kind: AnyStepKind, inputs: Any, step: Step, path: str, limit: float | None
    ) -> dict[str, Any] | None:
        """One attempt at a step, within `limit` seconds (None: no limit). Raises the step's errors, TimeoutError."""
        attempt = self._record.next_attempt(path)
        context = Context(
            step=path,
            attempt=attempt,
            run=self._run,
            needs=frozenset(kind.needs),
            uses=frozenset(kind.uses),
            journal=self._record,
            append=self._recorder.append,
        )

        async def done() -> dict[str, Any] | None:
            return kind.dump_result(await kind(context, inputs))

        return await self._recorder.attempt(StepStarted(path, attempt, kind.moves, step.do), limit, done)

    async def _wait_while_held(self) -> None:
        """Between two steps: check interlocks and inputs, and wait while the run is blocked."""
        await self._interlocks.look()
        await self._reports.between_steps()
        if self._control.aborted:
            await asyncio.sleep(0)  # the cancellation arrives here, before the next step begins
        reason = self._control.held_by()
        if not reason:
            return
        self._enter(State.PAUSED, reason)
        while self._control.held_by():
            # A simulated cell's time is stopped while only a person is awaited; broken interlocks need it to run.
            awaits_a_person = self._interlocks.awaits_only_a_person
            with self._clock.standing() if awaits_a_person else nullcontext():
                await self._control.change()
            if awaits_a_person and self._interlocks.broken:  # then the robot has to report what the person did
                await self._clock.sleep(NOTICED_AFTER_S)
            await self._interlocks.look()
            await self._reports.between_steps()
        self._enter(State.RUNNING, BY_OPERATOR if reason == BY_OPERATOR else "the interlocks hold again")


def _in_one_line(causes: Iterable[str]) -> str:
    """Causes without their cures, which stand on lines of their own."""
    return "; ".join(cause.partition("\n")[0] for cause in causes)


def _pass_begins(path: str, index: int, count: int, watcher: Watcher) -> None:
    watcher.loop(path, index, count)
