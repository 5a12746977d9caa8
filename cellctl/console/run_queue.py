"""Runs that wait for their cell or their time: offered, and started only when a person confirms.

`queue.jsonl` of the folder of runs keeps them. Worker processes are in `jobs.py`.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime, time, timedelta
from pathlib import Path
from typing import Any, Literal, final

from cellctl.clock import calendar_time
from cellctl.devices.cell import ClockMode
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.files.json_lines import FollowedLines

FILE_NAME = "queue.jsonl"

PATIENCE = timedelta(minutes=10)
"""An offer that nobody confirms within this time lapses."""

State = Literal["waiting", "offered", "started", "lapsed", "removed"]

KEPT = 200
"""Number of entries that are over and still listed."""


@final
@dataclass(frozen=True, slots=True)
class Planned:
    """What to run: names of procedure and cell, settings, seed and clock as of `RunOrder`."""

    procedure: str
    cell: str
    settings: Mapping[str, str] = field(default_factory=dict)
    seed: int | None = None
    clock: ClockMode | None = None


@final
@dataclass(frozen=True, slots=True)
class QueuedRun:
    """A run that is to be started on `host`. by: who queued it; schedule: the id of the one that did, else empty.

    at: of the last change of its state; until: an offer lapses then; both UTC, ISO 8601. run: its name once started.
    who: confirmed or removed it. why: it lapsed.
    """

    id: str
    planned: Planned
    host: str
    by: str
    added: str
    schedule: str = ""
    state: State = "waiting"
    at: str = ""
    until: str = ""
    run: str = ""
    who: str = ""
    why: str = ""


@final
@dataclass(frozen=True, slots=True)
class Schedule:
    """Offers a run on `host` at `time` (`06:00`, local time of the host) on `weekdays` (ISO, 1 is Monday)."""

    id: str
    planned: Planned
    host: str
    by: str
    added: str
    time: str
    weekdays: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 7)

    def between(self, begin: datetime, end: datetime) -> bool:
        """Whether its time comes after `begin` and not after `end`."""
        return any(begin < at <= end for at in self._around(end))

    def next_after(self, now: datetime) -> datetime | None:
        """Its next time after `now`."""
        return next((at for at in self._around(now, 8) if at > now), None)

    def _around(self, now: datetime, days: int = 1) -> list[datetime]:
        """Its times from the day before `now` to `days` after it. A time that the clocks leave out is moved by them."""
        today, at = now.astimezone().date(), time.fromisoformat(self.time)
        each = (today + timedelta(days=day) for day in range(-1, days + 1))
        return [datetime.combine(day, at).astimezone() for day in each if day.isoweekday() in self.weekdays]


def utc_now() -> datetime:
    """The time of the computer, UTC, in whole seconds."""
    return datetime.fromisoformat(calendar_time())


@final
class RunQueue:
    """The planned runs in a folder of runs. Belongs to the event loop; several consoles may write one file.

    changed: is called with each entry that is new or has another state.
    """

    def __init__(
        self,
        folder: Path,
        host: str,
        changed: Callable[[QueuedRun], object] = lambda _: None,
        now: Callable[[], datetime] = utc_now,
    ) -> None:
        self._lines, self.host = FollowedLines(folder / FILE_NAME), host
        self._changed, self._now = changed, now
        self._entries: dict[str, QueuedRun] = {}
        self._schedules: dict[str, Schedule] = {}
        self._looked = now()
        self._lock = asyncio.Lock()

    @property
    def entries(self) -> list[QueuedRun]:
        """In the order in which they were queued; of those that are over the latest."""
        found = list(self._entries.values())
        over = [entry.id for entry in found if entry.state in ("started", "removed")][:-KEPT]
        return [entry for entry in found if entry.id not in over]

    @property
    def offers(self) -> list[QueuedRun]:
        """Those that a person may confirm now."""
        return [entry for entry in self._entries.values() if entry.state == "offered"]

    @property
    def schedules(self) -> list[Schedule]:
        """The schedules, the oldest first."""
        return list(self._schedules.values())

    async def refresh(self) -> bool:
        """Read the file if it was changed, by another console too; returns whether it was."""
        async with self._lock:
            return await self._refreshed()

    async def add(self, planned: Planned, operator: Operator) -> QueuedRun:
        """Queue a run, at the end. Raises OSError."""
        async with self._lock:
            await self._refreshed()
            return await self._add(planned, operator.name)

    async def add_schedule(self, planned: Planned, operator: Operator, at: str, weekdays: tuple[int, ...]) -> Schedule:
        """Add a schedule. Raises InputError, OSError."""
        try:
            at = time.fromisoformat(at).strftime("%H:%M")
        except ValueError:
            raise InputError(Problem("time", 0, 0, f"'{at[:20]}' is no time", "write it as 06:00")) from None
        if not weekdays:
            raise InputError(Problem("weekdays", 0, 0, "no day is chosen", "choose one or more: 1 is Monday"))
        async with self._lock:
            await self._refreshed()
            days = tuple(sorted(set(weekdays)))
            found = Schedule(_new_id(), planned, self.host, operator.name, self._time(), at, days)
            await self._lines.append({"kind": "schedule", **asdict(found)})
            self._schedules[found.id] = found
            return found

    async def remove_schedule(self, number: str, operator: Operator) -> None:
        """Remove a schedule; what it has queued stays. Raises LookupError, InputError, OSError."""
        async with self._lock:
            await self._refreshed()
            self._own(self._schedules[number])
            line = {"id": number, "removed": self._time(), "who": operator.name}
            await self._lines.append(line)
            del self._schedules[number]

    async def remove(self, number: str, operator: Operator) -> QueuedRun:
        """Take a run from the queue. Raises LookupError, InputError, OSError."""
        return await self._change(number, ("waiting", "offered", "lapsed"), state="removed", who=operator.name)

    async def offer_again(self, number: str, operator: Operator) -> QueuedRun:
        """Let a lapsed run wait again. Raises LookupError, InputError, OSError."""
        return await self._change(number, ["lapsed"], state="waiting", until="", why="", who=operator.name)

    async def started(self, number: str, operator: Operator, run: str) -> QueuedRun:
        """Record that an offer was confirmed, and which run it is. Raises LookupError, InputError, OSError."""
        return await self._change(number, ("offered", "lapsed"), state="started", run=run, who=operator.name)

    def offer(self, number: str) -> QueuedRun:
        """The offer with this id, which may be confirmed now. Raises LookupError, InputError."""
        entry = self._entries[number]
        self._own(entry)
        if entry.state != "offered" or self._over(entry):
            state = "lapsed" if entry.state == "offered" else entry.state
            what, cure = f"is not offered now: it is {state}", "confirm it within 10 minutes of its offer"
            raise InputError(Problem(_title(entry), 0, 0, what, cure))
        return entry

    async def look(self, busy: Collection[str]) -> None:
        """Let schedules queue runs, offer what may be offered, and let offers lapse. busy: cells with an active run.

        Only one console of a host may do this. Raises OSError.
        """
        async with self._lock:
            await self._refreshed()
            now = self._now()
            begin, self._looked = max(self._looked, now - PATIENCE), now  # nothing is made up for after a long sleep
            for schedule in self._schedules.values():
                if schedule.host == self.host and schedule.between(begin, now):
                    await self._add(schedule.planned, schedule.by, schedule.id)
            for entry in [each for each in self.offers if each.host == self.host and self._over(each)]:
                why = f"nobody confirmed it within {PATIENCE.seconds // 60} minutes"
                await self._set(replace(entry, state="lapsed", why=why))
            taken = {*busy, *(entry.planned.cell for entry in self.offers)}
            for entry in list(self._entries.values()):
                if entry.host == self.host and entry.planned.cell not in taken and self._may_be_offered(entry):
                    taken.add(entry.planned.cell)
                    await self._set(replace(entry, state="offered", until=_iso(now + PATIENCE)))

    def _may_be_offered(self, entry: QueuedRun) -> bool:
        """What a person queued waits behind a lapsed one: else a queue would lapse as a whole while nobody is there."""
        if entry.state != "waiting":
            return False
        lapsed = (each for each in self._entries.values() if each.state == "lapsed" and not each.schedule)
        return bool(entry.schedule) or not any(
            (each.planned.cell, each.host) == (entry.planned.cell, entry.host) for each in lapsed
        )

    def _over(self, entry: QueuedRun) -> bool:
        return _iso(self._now()) >= entry.until

    async def _add(self, planned: Planned, by: str, schedule: str = "") -> QueuedRun:
        entry = QueuedRun(_new_id(), planned, self.host, by, self._time(), schedule)
        await self._lines.append({"kind": "queued", **asdict(entry)})
        self._keep(entry)
        return entry

    async def _change(self, number: str, states: Collection[State], **fields: Any) -> QueuedRun:
        async with self._lock:
            await self._refreshed()
            entry = self._entries[number]
            self._own(entry)
            if entry.state not in states:
                raise InputError(Problem(_title(entry), 0, 0, f"is {entry.state}", "look at the queue again"))
            return await self._set(replace(entry, **fields))

    async def _set(self, entry: QueuedRun) -> QueuedRun:
        entry = replace(entry, at=self._time())
        names = ("id", "state", "at", "until", "run", "who", "why")
        await self._lines.append({name: getattr(entry, name) for name in names})
        self._keep(entry)
        return entry

    def _own(self, found: QueuedRun | Schedule) -> None:
        if found.host != self.host:
            what = f"is of {found.host}, and this console runs on {self.host}"
            raise InputError(Problem(_title(found), 0, 0, what, f"use the console on {found.host}"))

    def _keep(self, entry: QueuedRun) -> None:
        self._entries[entry.id] = entry
        self._changed(entry)

    async def _refreshed(self) -> bool:
        lines = await self._lines.changed()
        if lines is None:
            return False
        self._entries.clear()
        self._schedules.clear()
        for line in lines:
            try:
                self._fold(line)
            except (TypeError, ValueError, KeyError):  # of a newer version, or not ours
                logging.getLogger(__name__).warning("%s: a line cannot be read: %.200s", self._lines.path, line)
        return True

    def _fold(self, line: dict[str, Any]) -> None:
        number, kind = line["id"], line.pop("kind", "")
        if kind:
            line["planned"] = Planned(**line["planned"])
        if kind == "queued":
            self._entries[number] = QueuedRun(**line)
        elif kind == "schedule":
            time.fromisoformat(line["time"])
            self._schedules[number] = Schedule(**{**line, "weekdays": tuple(line["weekdays"])})
        elif "removed" in line:
            self._schedules.pop(number, None)
        else:
            self._entries[number] = replace(self._entries[number], **line)

    def _time(self) -> str:
        return _iso(self._now())


def _title(found: QueuedRun | Schedule) -> str:
    return f"{found.planned.procedure} on {found.planned.cell}"


def _new_id() -> str:
    return secrets.token_hex(8)


def _iso(at: datetime) -> str:
    return at.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
