"""Watches the runs: events for programs, alarms, and what waits for a person. The same for all pages and the API."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import final

from cellctl.console.alarms import Alarm, AlarmLog, Cause, Happened
from cellctl.console.live import LiveRuns, Snapshot
from cellctl.console.live.changes import run_changes, waits_for
from cellctl.console.live.events import EventStream
from cellctl.console.live.runs import Subscribers
from cellctl.console.run_queue import QueuedRun, RunQueue, utc_now
from cellctl.files.locked import LockedByOther, LockedFile
from cellctl.journal import RunState, last_number
from cellctl.journal.journal_file import FILE_NAME
from cellctl.metrology.daily_check import DailyAction
from cellctl.operations.cell_state import DeviceState, out_of_order
from cellctl.operations.run_indexing import summary_of
from cellctl.operations.run_list import RunSummary
from cellctl.run_index import RunIndex

TICK_S = 5.0
"""Wall time between two looks at what no run tells: other consoles' lines, schedules, offers."""

CALIBRATIONS_S = 600.0
"""Wall time between two looks at the age of calibrations, counted in days, and at the charts of all robots."""

RECENT_S = 24 * 3600.0
"""A run that ended before, while no console ran, raises an alarm if that was within this time."""

_NEWEST = 100
"""Number of the runs that began last: one that ends is among them, or was in progress when the console looked."""


@final
@dataclass(frozen=True, slots=True)
class Waiting:
    """What waits for a person: a run in progress, or an offered one. `what`: to do; `address`: the page where."""

    what: str
    address: str


@final
class Watch:
    """What a console knows besides the runs' state. Belongs to the event loop; `run` keeps it up to date.

    Of several consoles of a host on one folder one alone raises alarms and offers runs: the one that holds a lock.
    """

    def __init__(self, folder: Path, host: str = "") -> None:
        self.host = host or socket.gethostname()
        self.events = EventStream(f"{time.time_ns() // 1_000_000:x}")
        self.alarms = AlarmLog(folder, self._on_alarm)
        self.queue = RunQueue(folder, self.host, self._on_queue)
        self.waiting: tuple[Waiting, ...] = ()
        self.due: Callable[[RunIndex], Iterator[tuple[Cause, bool]]] = lambda _: iter(())
        self._folder = folder
        self._lock: LockedFile | None = None
        self._subscribers = Subscribers()
        self._seen: dict[str, Snapshot] = {}
        self._states: int | None = None
        self._ends: dict[str, tuple[str, int | None]] = {}
        self._failures = _OldFailures()
        self._devices: dict[str, dict[str, str]] = {}
        self._began = utc_now().timestamp()
        self._due = {"tick": 0.0, "queue": 0.0, "calibrations": 0.0}
        self._trouble = ""

    def subscribe(self, callback: Callable[[], object]) -> Callable[[], None]:
        """Call `callback` when alarms, the queue, or what waits for a person changed; returns what ends that."""
        return self._subscribers.add(callback)

    async def run(self, live: LiveRuns) -> None:
        """Watch, until it is cancelled."""
        changed = asyncio.Event()
        end = live.subscribe(changed.set)
        try:
            while True:
                await self.look(live)
                try:
                    async with asyncio.timeout(TICK_S):  # wait_for of Python 3.11 can lose a cancellation
                        await changed.wait()
                except TimeoutError:
                    continue
                changed.clear()
        finally:
            end()
            if self._lock:
                self._lock.release()

    async def look(self, live: LiveRuns) -> None:
        """Look once. An error is logged once, and tried again at the next look."""
        try:
            if self._is_due("tick", TICK_S):
                await self._tick()
            active, ended = self._look_at_active(live)
            await self._look_at_ended(live)
            if self._lock:
                await self._raise(active, ended)
                if self._is_due("queue", TICK_S):
                    await self._look_at_queue(active)
                if not live.reading and self._is_due("calibrations", CALIBRATIONS_S):
                    await self._look_at_calibrations(live)
            self._show_waiting(active)
            self._trouble = ""
        except Exception as error:  # a full disk, a folder that cannot be written
            if str(error) != self._trouble:
                logging.getLogger(__name__).exception("alarms and offers are not up to date")
            self._trouble = str(error) or type(error).__name__

    async def examined(self, cell: str, devices: Collection[DeviceState]) -> None:
        """Devices of the cell were examined: raise and clear the alarms of lost ones."""
        self._devices[cell] = {each.name: each.state for each in devices}
        self.events.publish("cell_state", cell=cell, source="doctor", devices=self._devices[cell])
        for device in devices:
            cause = f"device:{cell}:{device.name}"
            if device.state == "failed":
                what = f"{device.name}: {device.last_error or device.text}"
                await self.alarms.raise_(Cause("device", cause, what, device.cure, cell))
            elif device.state == "in order":
                await self.alarms.clear([cause], "in order at the examination")

    async def _tick(self) -> None:
        if self._lock is None:
            self._lock = await asyncio.to_thread(_taken, self._folder / f"console-{self.host}.lock")
        if await self.alarms.refresh() | await self.queue.refresh():
            self._subscribers.call({""})

    def _look_at_active(self, live: LiveRuns) -> tuple[list[Snapshot], list[Snapshot]]:
        """Publish what changed of the runs in progress; returns those, and the ones that have just ended."""
        active, ended = [], []
        for name in dict.fromkeys([*live.active, *self._seen]):
            run = live.run(name)
            if not run.known:
                continue
            now, before = run.snapshot, self._seen.get(name)
            if before is None or before.version != now.version:
                for kind, data in run_changes(before, now):
                    self.events.publish(kind, **data)
                self._publish_devices(now)
            if now.active:
                active.append(now)
                self._seen[name] = now
            elif self._seen.pop(name, None):
                ended.append(now)
        return active, ended

    def _publish_devices(self, now: Snapshot) -> None:
        """Publish the devices' states if they are not those that were published last of this cell."""
        cell, failed = cell_of(now.state), out_of_order(now.state)
        each = now.state.health.items()
        devices = {name: "failed" if name in failed or not health.ok else "in order" for name, health in each}
        if devices and self._devices.get(cell) != devices:
            self._devices[cell] = devices
            self.events.publish("cell_state", cell=cell, source=f"run {now.run}", devices=devices)

    async def _look_at_ended(self, live: LiveRuns) -> None:
        """Runs that have ended since the last look; at first the latest, of which old ones raise nothing."""
        if live.reading or live.states_version == self._states:
            return
        first, states = self._states is None, live.states_version
        found = await asyncio.to_thread(lambda: live.index.page(limit=_NEWEST))
        self._states = states
        for row in map(summary_of, reversed(found)):
            if row.process:
                self._ends.pop(row.run, None)
            elif self._ends.get(row.run) != (row.state, row.attempts):
                self._ends[row.run] = (row.state, row.attempts)
                age_s = utc_now().timestamp() - _changed(self._folder / row.run)
                if not first and age_s < utc_now().timestamp() - self._began + TICK_S:
                    data = {"state": row.state, "verdict": row.verdict, "sentence": row.sentence}
                    self.events.publish("run_ended", run=row.run, **data)
                if self._lock and age_s < RECENT_S:
                    await self._raise_of_end(row)

    async def _raise(self, active: Collection[Snapshot], ended: Collection[Snapshot]) -> None:
        """Raise the alarms of runs in progress, and clear those whose cause has gone."""
        causes = {cause.cause: cause for now in (*active, *ended) for cause in self._causes(now)}
        for cause in causes.values():
            await self.alarms.raise_(cause)
        runs = {now.run: now for now in active}
        continued = [alarm.cause for alarm in self.alarms.standing if alarm.kind == "run" and alarm.run in runs]
        await self._clear(continued, "the run was continued")
        held = [alarm for alarm in self.alarms.standing if alarm.kind == "interlock" and alarm.cause not in causes]
        await self._clear([alarm.cause for alarm in held if alarm.run in runs], "it holds again")
        over = [alarm.cause for alarm in held if alarm.run in self._ends]  # not one that is not read yet, after a start
        await self._clear(over, "the run has ended")
        works = {
            f"device:{cell_of(now.state)}:{name}"
            for now in active
            for name, health in now.state.health.items()
            if health.ok
        }
        await self._clear(works - set(causes), "it works in a run")

    def _causes(self, now: Snapshot) -> Iterator[Cause]:
        cell = cell_of(now.state)
        for text in now.status.broken if now.active else ():
            yield Cause("interlock", f"interlock:{cell}:{text}", text, "look at the cell", cell, now.run)
        for device, (text, cure) in self._failures.of(now).items():
            mark = f"{now.run} {text}"
            yield Cause("device", f"device:{cell}:{device}", f"{device}: {text}", cure, cell, now.run, mark)

    async def _raise_of_end(self, found: RunSummary) -> None:
        run, cell = found.run, Path(found.cell or "").stem
        if found.state in ("failed", "uncertain") or found.state.startswith("cut off"):
            what = f"{run}: {found.state}" + (f": {found.problem}" if found.problem else "")
            end = await asyncio.to_thread(last_number, self._folder / run)
            cause = Cause("run", f"run:{run}", what, found.cure or "", cell, run, str(end))
            await self.alarms.raise_(cause)
        charts = f"chart:{found.serial}"
        if found.verdict == DailyAction.RECALIBRATE:
            what = f"daily check of {found.serial}: {found.sentence or found.verdict}"
            await self.alarms.raise_(Cause("chart", charts, what, "calibrate the robot", cell, run, run))
        elif found.verdict == DailyAction.IN_CONTROL:
            await self._clear([charts], f"in control again: {run}")

    async def _look_at_queue(self, active: Collection[Snapshot]) -> None:
        await self.queue.look({cell_of(now.state) for now in active})
        lapsed = [entry for entry in self.queue.entries if entry.state == "lapsed" and entry.host == self.host]
        for entry in lapsed:
            plan = entry.planned
            what = f"{plan.procedure} on {plan.cell} was not started: {entry.why}"
            cause = Cause("job", f"job:{entry.id}", what, "offer it again, or remove it", plan.cell, "", entry.at)
            await self.alarms.raise_(cause)
        stand = {alarm.cause for alarm in self.alarms.standing if alarm.kind == "job"}
        await self._clear(stand - {f"job:{entry.id}" for entry in lapsed}, "it was offered again, or removed")

    async def _look_at_calibrations(self, live: LiveRuns) -> None:
        for cause, due in await asyncio.to_thread(lambda: list(self.due(live.index))):
            if due:
                await self.alarms.raise_(cause)
            else:
                why = "within its limits" if cause.kind == "chart" else "calibrated"
                await self._clear([cause.cause], why)

    async def _clear(self, causes: Collection[str], why: str) -> None:
        if any(alarm.cause in causes for alarm in self.alarms.standing):
            await self.alarms.clear(causes, why)

    def _show_waiting(self, active: Collection[Snapshot]) -> None:
        runs = [Waiting(f"{now.run}: {text}", f"/run/{now.run}") for now in active if (text := waits_for(now))]
        offers = [
            Waiting(f"{entry.planned.procedure} on {entry.planned.cell}: confirm its start", "/jobs")
            for entry in self.queue.offers
        ]
        if (now := (*runs, *offers)) != self.waiting:
            self.waiting = now
            self._subscribers.call({""})

    def _on_alarm(self, what: Happened, alarm: Alarm) -> None:
        self.events.publish(what, **{name: value for name, value in asdict(alarm).items() if value})
        self._subscribers.call({""})

    def _on_queue(self, entry: QueuedRun) -> None:
        self.events.publish("job_offered" if entry.state == "offered" else "job_changed", **asdict(entry))
        self._subscribers.call({""})

    def _is_due(self, what: str, every_s: float) -> bool:
        now = time.monotonic()
        if now < self._due[what]:
            return False
        self._due[what] = now + every_s
        return True


def cell_of(state: RunState) -> str:
    """The name of a run's cell: its file's, without suffix; empty before its start."""
    return Path(state.started.cell.path).stem if state.started else ""


@final
class _OldFailures:
    """Failures of devices from before a run was resumed: it has connected to them anew since."""

    def __init__(self) -> None:
        self._old: dict[str, tuple[int, dict[str, tuple[str, str]]]] = {}

    def of(self, now: Snapshot) -> dict[str, tuple[str, str]]:
        """Device → text and cure of the failures since the run began, or was resumed last."""
        found = out_of_order(now.state)
        resumed, old = self._old.get(now.run, (0, {}))
        if now.state.resumed != resumed:
            old = found
            self._old[now.run] = (now.state.resumed, old)
        return {device: failure for device, failure in found.items() if old.get(device) != failure}


def _changed(run: Path) -> float:
    try:
        return (run / FILE_NAME).stat().st_mtime
    except OSError:
        return 0.0


def _taken(path: Path) -> LockedFile | None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return LockedFile.take(path, f"{socket.gethostname()}\n")
    except (LockedByOther, OSError):
        return None
