"""The runner connects the devices, runs the steps, always cleans up, and writes the journal."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import final

from cellctl.clock import Clock, calendar_time
from cellctl.devices import Device, DeviceError, DeviceUncertain, DeviceUnreachable, Identity, MovingRobot
from cellctl.engine._context import AfterConnect, Plan, Surround
from cellctl.engine._control import Control, Interlocks, Reset
from cellctl.engine._mailbox import Mailbox, MailboxFolder
from cellctl.engine._recorder import NobodyWatching, Recorder, Watcher
from cellctl.engine._run_devices import CLEANUP_SECONDS, DeviceReports, stop_and_close
from cellctl.engine._states import Aborted, Outcome, State, checked
from cellctl.engine._step_execution import StepExecution
from cellctl.engine._waiting import beside, ended, error_of
from cellctl.journal import DevicesConnected, Journal, RunEnded, RunState, StateChanged
from cellctl.procedure import Step, inputs_of, step_path
from cellctl.records import VerdictRow


@final
class Engine:
    """Runs one procedure once, or continues it: `record` is the content of its journal so far.

    Steps that are done in `record` are not repeated, unless they have `on_resume: always`. `meet`: called with the
    identity of each connected device before anything is done with them; raises DeviceError for a device that another
    process has, and then all are closed without clean-up: they are not this run's. `reset`: presses the
    reset of a simulated cell; None: the cell is real. `cell_ended`: why its simulators have ended; empty: they run.
    """

    def __init__(
        self,
        plan: Plan,
        run: Surround,
        journal: Journal,
        mailbox: Mailbox,
        watcher: Watcher | None = None,
        record: RunState | None = None,
        meet: Callable[[Identity], None] | None = None,
        reset: Reset | None = None,
        cell_ended: Callable[[], str] = str,
    ) -> None:
        self._plan, self._meet, self._cell_ended = plan, meet, cell_ended
        self._run = run
        self._clock: Clock = run.clock
        self._recorder = Recorder(journal, record or RunState(), watcher or NobodyWatching(), run.clock)
        self._record = self._recorder.state
        self._mailbox = mailbox
        self._control = Control(mailbox, self._recorder, reset)
        self._interlocks = Interlocks(plan.procedure, plan.devices, run.clock, self._control.interlock_changed)
        self._control.interlocks = self._interlocks
        self._connected: list[Device] = []
        self._answered: set[str] = set()
        self._stopped: set[str] = set()
        self._reports = DeviceReports(self._recorder)
        self._steps = StepExecution(
            plan, run, self._recorder, self._control, self._interlocks, self._reports, self._enter
        )
        self.state = State.IDLE

    async def run(self, after_connect: AfterConnect | None = None) -> Outcome:
        """Connect, run the steps, clean up. The outcome contains the errors.

        `after_connect` is awaited once every device answers, before the first step. Raises only CancelledError, after
        the clean-up and the journal's last event, if the caller was cancelled.
        """
        began = self._clock.now()
        self._enter(State.CHECKING, "")
        async with MailboxFolder(self._run.run_folder).emptied_into(self._mailbox):
            self._mailbox.taken_by(self._control.take)
            error, troubles, cancelled = await self._worked(after_connect)
        end = self._end_state(error, troubles)
        self._enter(end, "; ".join([*([str(error)] if error else []), *troubles]))
        verdict = self._record.last(VerdictRow)
        seconds, moved, held = self._clock.now() - began, self._steps.moved, self._held()
        outcome = Outcome(end, error or self._recorder.error, tuple(troubles), verdict, seconds, moved, held)
        ended = RunEnded(end.value, verdict.verdict if verdict else "", str(error or ""))
        self._recorder.append(replace(ended, troubles=outcome.troubles, robot=outcome.robot, calendar=calendar_time()))
        self._mailbox.taken_by(lambda _: None)
        if cancelled:
            raise asyncio.CancelledError
        return replace(outcome, error=error or self._recorder.error)

    async def _worked(self, after_connect: AfterConnect | None) -> tuple[BaseException | None, list[str], bool]:
        """Work and clean-up; returns the work's error, the clean-up's failures, and if the caller was cancelled."""
        work = asyncio.create_task(self._work(after_connect), name="campaign")
        self._control.cancel = work.cancel
        if self._control.aborted:
            work.cancel()
        cancelled = await ended(work, on_cancel=work.cancel)
        self._control.ending = True
        error = error_of(work)
        if isinstance(error, asyncio.CancelledError):
            error = self._control.aborted or Aborted("aborted: the program that runs it was cancelled")
        cleaning = asyncio.create_task(self._clean_up(error), name="clean-up")
        cancelled |= await ended(cleaning)
        return error, cleaning.result(), cancelled

    async def _work(self, after_connect: AfterConnect | None) -> None:
        self._enter(State.CONNECTING, "")
        identities = await self._connect()
        self._recorder.append(DevicesConnected({i.device: asdict(i) for i in identities}))
        await self._reports.at_start(self._connected)
        if after_connect:
            await after_connect()
        self._interlocks.install()
        self._enter(State.RUNNING, "")
        await self._interlocks.look()
        async with beside(self._interlocks.watch(), "interlocks"):
            await self._steps.actions(self._plan.procedure.steps, dict(self._plan.parameters), "")
            await self._reports.look_for_losses(self._connected)

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
        identities = tuple(result for result in results if isinstance(result, Identity))
        if self._meet:
            try:
                for identity in identities:
                    self._meet(identity)
            except (DeviceError, OSError):  # OSError: the folder of the locks cannot be written
                self._connected = []
                for device in devices:
                    await device.close()
                raise
        return identities

    async def _clean_up(self, error: BaseException | None) -> list[str]:
        """Try every clean-up step, stop and close every device; returns the failures as text.

        Interlocks were watched until the work ended. Here they stop nothing, so that a broken one cannot prevent the
        clean-up: the safety controller stops what must not move.
        """
        self._enter(State.CLEANING, str(error) if error else "")
        troubles: list[str] = []
        reached = self._run.devices.keys() if self._connected else set()
        for step in self._plan.procedure.cleanup:
            if self._plan.registry.find(step.do).needs.keys() <= reached:
                troubles += await self._clean_step(step)
        look = self._reports.at_end if error else None
        troubles += await stop_and_close(self._connected, self._clock, self._stopped, look)
        if error and (why := self._cell_ended()):
            troubles.append(why)
        return list(dict.fromkeys(troubles))

    async def _clean_step(self, step: Step) -> list[str]:
        path = step_path("cleanup", step.id)
        try:
            kind = self._plan.registry.find(step.do)
            inputs = inputs_of(self._plan.procedure, step, kind, self._plan.parameters)
            await self._steps.attempt(kind, inputs, step, path, step.timeout_s or CLEANUP_SECONDS)
        except Exception as failure:
            return [f"clean-up step '{step.id}' failed: {failure}"]
        return []

    def _held(self) -> bool:
        """Whether every robot of the cell answered, and confirmed standstill in the clean-up."""
        robots = {device.name for device in self._plan.devices.values() if isinstance(device, MovingRobot)}
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
