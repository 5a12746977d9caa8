"""Alarms: raised, acknowledged by a person, cleared; kept in `alarms.jsonl` of the folder of runs."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, final

from cellctl.clock import calendar_time
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.files.json_lines import FollowedLines

FILE_NAME = "alarms.jsonl"

Kind = Literal["run", "interlock", "device", "chart", "calibration", "job"]

KINDS: dict[Kind, str] = {
    "run": "run failed, uncertain or cut off",
    "interlock": "interlock does not hold",
    "device": "device lost",
    "chart": "chart out of its limits",
    "calibration": "calibration due",
    "job": "job lapsed",
}

Happened = Literal["alarm_raised", "alarm_acknowledged", "alarm_cleared"]

OVER: frozenset[Kind] = frozenset({"run", "job"})
"""Kinds of alarms whose cause is over when they are raised: the acknowledgement clears them."""

_ACKNOWLEDGED = ("acknowledged", "by", "host", "words")
_CLEARED = ("cleared", "why")


@final
@dataclass(frozen=True, slots=True)
class Cause:
    """What an alarm is for. `cause`: one alarm stands for it at a time; `mark`: of what happens once, such as the end
    of a run: no second alarm follows, not after the first was cleared, nor after a restart; empty: it may come again.

    cell: name of the cell; run: name of the run; both empty without one. what: for people; cure: what to do.
    """

    kind: Kind
    cause: str
    what: str
    cure: str = ""
    cell: str = ""
    run: str = ""
    mark: str = ""


@final
@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm. Times: UTC, ISO 8601; empty: not yet. by, host, words: of the acknowledgement. why: it cleared."""

    id: str
    kind: Kind
    cause: str
    what: str
    cure: str
    cell: str
    run: str
    mark: str
    raised: str
    acknowledged: str = ""
    by: str = ""
    host: str = ""
    words: str = ""
    cleared: str = ""
    why: str = ""

    @property
    def stands(self) -> bool:
        """Whether its cause has not gone."""
        return not self.cleared

    @property
    def unseen(self) -> bool:
        """Whether it stands and nobody has acknowledged it."""
        return not self.cleared and not self.acknowledged


@final
class AlarmLog:
    """The alarms of a folder of runs. Belongs to the event loop; several consoles may write one file.

    changed: is called with what happened (`alarm_raised` …) and the alarm.
    """

    def __init__(self, folder: Path, changed: Callable[[Happened, Alarm], object] = lambda *_: None) -> None:
        self._lines = FollowedLines(folder / FILE_NAME)
        self._changed = changed
        self._alarms: dict[str, Alarm] = {}
        self._marks: set[tuple[str, str]] = set()
        self._lock = asyncio.Lock()

    @property
    def all(self) -> list[Alarm]:
        """The alarms that are known, newest first."""
        return list(reversed(self._alarms.values()))

    @property
    def standing(self) -> list[Alarm]:
        """Those whose cause has not gone, newest first."""
        return [alarm for alarm in self.all if alarm.stands]

    @property
    def unseen(self) -> list[Alarm]:
        """Those that stand and that nobody has acknowledged, newest first."""
        return [alarm for alarm in self.all if alarm.unseen]

    async def refresh(self) -> bool:
        """Read the file if it was changed, by another console too; returns whether it was."""
        async with self._lock:
            return await self._refreshed()

    async def raise_(self, cause: Cause) -> Alarm | None:
        """Raise an alarm; None if one stands for its cause, or its mark had one. Raises OSError."""
        if self._is_known(cause):  # the usual case: no look at the file
            return None
        async with self._lock:
            await self._refreshed()
            if self._is_known(cause):
                return None
            alarm = Alarm(secrets.token_hex(8), raised=calendar_time(), **asdict(cause))
            await self._write("alarm_raised", alarm, {name: value for name, value in asdict(alarm).items() if value})
            return alarm

    async def acknowledge(self, number: str, operator: Operator, words: str = "") -> Alarm:
        """Record that `operator` has seen the alarm with this id. Raises LookupError, InputError, OSError."""
        async with self._lock:
            await self._refreshed()
            if number not in self._alarms:
                raise LookupError(number)
            alarm = self._alarms[number]
            if not alarm.unseen:
                how = f"was acknowledged by {alarm.by}" if alarm.acknowledged else f"has cleared: {alarm.why}"
                raise InputError(Problem(alarm.what, 0, 0, how, "nothing is left to acknowledge"))
            now = calendar_time()
            seen = replace(alarm, acknowledged=now, by=operator.name, host=operator.host, words=words)
            if alarm.kind in OVER:
                seen = replace(seen, cleared=now, why="acknowledged")
            fields = (*_ACKNOWLEDGED, *_CLEARED)
            await self._write("alarm_acknowledged", seen, {"id": number, **_filled(seen, fields)})
            return seen

    async def clear(self, causes: Iterable[str], why: str) -> None:
        """Clear the alarms that stand for one of `causes`. Raises OSError."""
        async with self._lock:
            await self._refreshed()
            gone = set(causes)
            for alarm in [each for each in self.standing if each.cause in gone]:
                cleared = replace(alarm, cleared=calendar_time(), why=why)
                await self._write("alarm_cleared", cleared, {"id": alarm.id, **_filled(cleared, _CLEARED)})

    def _is_known(self, cause: Cause) -> bool:
        marked = bool(cause.mark) and (cause.cause, cause.mark) in self._marks
        return marked or any(alarm.cause == cause.cause and alarm.stands for alarm in self._alarms.values())

    async def _write(self, what: Happened, alarm: Alarm, line: dict[str, Any]) -> None:
        await self._lines.append(line)
        self._keep(alarm)
        self._changed(what, alarm)

    async def _refreshed(self) -> bool:
        lines = await self._lines.changed()
        if lines is None:
            return False
        self._alarms.clear()
        for line in lines:
            try:
                known = self._alarms.get(line["id"])
                self._keep(replace(known, **line) if known else Alarm(**{**_NOTHING, **line}))
            except TypeError:  # a field of a newer version
                logging.getLogger(__name__).warning("%s: an alarm cannot be read: %.200s", self._lines.path, line)
        return True

    def _keep(self, alarm: Alarm) -> None:
        self._alarms[alarm.id] = alarm
        if alarm.mark:
            self._marks.add((alarm.cause, alarm.mark))


_NOTHING = dict.fromkeys(("kind", "cause", "what", "cure", "cell", "run", "mark", "raised"), "")


def _filled(alarm: Alarm, fields: Iterable[str]) -> dict[str, str]:
    return {name: value for name in fields if (value := getattr(alarm, name))}
