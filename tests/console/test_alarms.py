"""Alarms: one for one cause until it clears, acknowledged by name, kept beside the runs."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from cellctl.console.alarms import FILE_NAME, AlarmLog, Cause
from cellctl.console.sessions import operator_named
from cellctl.files import InputError

DEVICE = Cause("device", "device:hall7:probe", "probe: no answer", "check its cable", "hall7", "run-1")
FAILED = Cause("run", "run:run-1", "run-1: failed", "look", "hall7", "run-1", mark="17")
ADA = operator_named("Ada")


def test_one_cause_is_one_alarm_until_it_clears(tmp_path: Path) -> None:
    async def see() -> None:
        seen: list[str] = []
        log = AlarmLog(tmp_path, lambda what, _: seen.append(what))
        assert await log.raise_(DEVICE)
        assert await log.raise_(DEVICE) is None
        await log.clear([DEVICE.cause, "device:other"], "it works in a run")
        assert log.standing == []
        assert await log.raise_(DEVICE)
        assert [alarm.why for alarm in log.all] == ["", "it works in a run"]
        assert seen == ["alarm_raised", "alarm_cleared", "alarm_raised"]

    asyncio.run(see())


def test_an_acknowledged_alarm_names_who_and_words_and_stands_until_its_cause_goes(tmp_path: Path) -> None:
    async def see() -> None:
        log = AlarmLog(tmp_path)
        alarm = await log.raise_(DEVICE)
        assert alarm
        seen = await log.acknowledge(alarm.id, ADA, "cable was out")
        assert (seen.by, seen.words, seen.stands, seen.unseen) == ("Ada", "cable was out", True, False)
        with pytest.raises(InputError, match="acknowledged by Ada"):
            await log.acknowledge(alarm.id, operator_named("Ben"))
        with pytest.raises(LookupError):
            await log.acknowledge("other", ADA)

    asyncio.run(see())


def test_an_alarm_of_what_is_over_clears_when_it_is_acknowledged_and_is_never_raised_again(tmp_path: Path) -> None:
    async def see() -> None:
        log = AlarmLog(tmp_path)
        alarm = await log.raise_(FAILED)
        assert alarm
        assert (await log.acknowledge(alarm.id, ADA)).why == "acknowledged"
        again = AlarmLog(tmp_path)  # of a console that was started again
        assert await again.raise_(FAILED) is None
        assert await again.raise_(replace(FAILED, mark="30"))  # it was continued, and failed again

    asyncio.run(see())


def test_alarms_outlive_the_console_and_another_console_sees_them(tmp_path: Path) -> None:
    async def see() -> None:
        log, other = AlarmLog(tmp_path), AlarmLog(tmp_path)
        alarm = await log.raise_(DEVICE)
        assert alarm
        assert await other.refresh()
        assert other.all == [alarm]
        seen = await other.acknowledge(alarm.id, ADA, "seen")
        assert await log.raise_(DEVICE) is None
        await log.refresh()
        assert log.all == [seen]
        assert not await log.refresh()

    asyncio.run(see())


def test_a_damaged_line_and_one_of_a_newer_version_hide_no_other(tmp_path: Path) -> None:
    async def see() -> list[str]:
        log = AlarmLog(tmp_path)
        await log.raise_(DEVICE)
        with (tmp_path / FILE_NAME).open("a") as stream:
            stream.write('{"id": "x", "planet": "Mars"}\n["id"]\n{"id": "cut')
        await log.raise_(FAILED)
        again = AlarmLog(tmp_path)
        await again.refresh()
        return [alarm.kind for alarm in again.all]

    assert asyncio.run(see()) == ["run", "device"]


def test_an_alarm_that_cannot_be_written_is_not_raised(tmp_path: Path) -> None:
    async def see() -> None:
        (tmp_path / FILE_NAME).mkdir()
        log = AlarmLog(tmp_path)
        with pytest.raises(OSError, match="directory"):
            await log.raise_(DEVICE)
        assert log.all == []

    asyncio.run(see())
