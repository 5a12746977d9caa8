"""Planned runs: offered by the clock or when their cell is free, started only by a person, lapsed after ten minutes."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from cellctl.console.run_queue import FILE_NAME, Planned, RunQueue
from cellctl.console.sessions import operator_named
from cellctl.files import InputError

ADA = operator_named("Ada")
TOUCH = Planned("touch", "hall7", {"points": "8"}, seed=3, clock="lockstep")
CHECK = Planned("daily_check", "hall7")


class Hands:
    """A clock that the test moves; 2026-11-24 is a Tuesday."""

    def __init__(self) -> None:
        self.now = datetime(2026, 11, 24, 5, 0, tzinfo=UTC)

    def __call__(self) -> datetime:
        return self.now

    def move(self, **by: float) -> None:
        self.now += timedelta(**by)


@pytest.fixture(autouse=True)
def in_berlin(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def states(queue: RunQueue) -> list[tuple[str, str]]:
    return [(entry.planned.procedure, entry.state) for entry in queue.entries]


def test_a_queued_run_waits_until_its_cell_is_free_and_then_for_a_person(tmp_path: Path) -> None:
    async def see() -> None:
        hands = Hands()
        queue = RunQueue(tmp_path, "pc", now=hands)
        first, second = await queue.add(TOUCH, ADA), await queue.add(CHECK, ADA)
        await queue.look(busy={"hall7"})
        assert states(queue) == [("touch", "waiting"), ("daily_check", "waiting")]
        with pytest.raises(InputError, match="not offered"):
            queue.offer(first.id)
        await queue.look(busy=())
        assert states(queue) == [("touch", "offered"), ("daily_check", "waiting")]
        assert queue.offer(first.id).planned == TOUCH
        await queue.started(first.id, ADA, "touch-1")
        await queue.look(busy={"hall7"})
        assert states(queue) == [("touch", "started"), ("daily_check", "waiting")]
        await queue.remove(second.id, ADA)
        assert queue.entries[1].who == "Ada"
        with pytest.raises(InputError, match="removed"):
            await queue.remove(second.id, ADA)
        with pytest.raises(LookupError):
            await queue.remove("other", ADA)

    asyncio.run(see())


def test_an_offer_lapses_after_ten_minutes_and_what_is_behind_it_waits_for_a_person(tmp_path: Path) -> None:
    async def see() -> None:
        hands = Hands()
        queue = RunQueue(tmp_path, "pc", now=hands)
        first, _ = await queue.add(TOUCH, ADA), await queue.add(CHECK, ADA)
        await queue.look(())
        hands.move(minutes=10)
        with pytest.raises(InputError, match="lapsed"):
            queue.offer(first.id)
        await queue.look(())
        assert states(queue) == [("touch", "lapsed"), ("daily_check", "waiting")]
        await queue.offer_again(first.id, ADA)
        await queue.look(())
        assert states(queue) == [("touch", "offered"), ("daily_check", "waiting")]

    asyncio.run(see())


def test_a_schedule_offers_its_run_once_at_its_local_time_on_its_days(tmp_path: Path) -> None:
    async def see() -> list[str]:
        hands = Hands()
        queue = RunQueue(tmp_path, "pc", now=hands)
        await queue.add_schedule(CHECK, ADA, "06:30", (2, 4))  # 05:30 UTC, Tuesday and Thursday
        found = []
        for _ in range(3 * 24 * 12):
            hands.move(minutes=5)
            before = len(queue.entries)
            await queue.look(())
            if len(queue.entries) > before:
                found.append(f"{hands.now:%a %H:%M}")
        assert {state for _, state in states(queue)} == {"lapsed"}
        return found

    assert asyncio.run(see()) == ["Tue 05:30", "Thu 05:30"]


@pytest.mark.parametrize(
    ("day", "at", "utc"),
    [("2026-03-28", "02:30", ["00:30"]), ("2026-10-24", "02:30", ["00:30"]), ("2026-06-30", "06:00", ["04:00"])],
)
def test_a_schedule_keeps_local_time_when_the_clocks_change_and_comes_once_a_day(
    tmp_path: Path, day: str, at: str, utc: list[str]
) -> None:
    async def see() -> list[str]:
        schedule = await RunQueue(tmp_path, "pc").add_schedule(CHECK, ADA, at, (1, 2, 3, 4, 5, 6, 7))
        begin = datetime.fromisoformat(f"{day}T12:00:00Z")
        found = []
        for number in range(24 * 60):
            now = begin + timedelta(minutes=number)
            if schedule.between(now - timedelta(minutes=1), now):
                found.append(f"{now:%H:%M}")
        return found

    found = asyncio.run(see())
    assert len(found) == 1
    if day != "2026-03-28":  # that night 02:30 is left out; the clocks decide
        assert found == utc


def test_a_schedule_does_not_make_up_for_times_at_which_no_console_ran(tmp_path: Path) -> None:
    async def see() -> None:
        hands = Hands()
        await RunQueue(tmp_path, "pc", now=hands).add_schedule(CHECK, ADA, "06:30", (2,))
        hands.move(hours=1)
        queue = RunQueue(tmp_path, "pc", now=hands)
        await queue.look(())
        assert (len(queue.schedules), queue.entries) == (1, [])
        (schedule,) = queue.schedules
        found = schedule.next_after(hands.now)
        assert found is not None
        assert f"{found:%a %H:%M %Z}" == "Tue 06:30 CET"
        await queue.remove_schedule(schedule.id, ADA)
        again = RunQueue(tmp_path, "pc", now=hands)
        await again.refresh()
        assert again.schedules == []

    asyncio.run(see())


def test_an_offer_outlives_the_console_starts_nothing_by_itself_and_lapses_at_its_time(tmp_path: Path) -> None:
    async def see() -> None:
        hands = Hands()
        queue = RunQueue(tmp_path, "pc", now=hands)
        entry = await queue.add(TOUCH, ADA)
        await queue.look(())
        hands.move(minutes=9)
        again = RunQueue(tmp_path, "pc", now=hands)
        await again.look(())
        assert again.entries == queue.entries
        assert again.offer(entry.id).state == "offered"
        hands.move(minutes=1)
        await again.look(())
        assert states(again) == [("touch", "lapsed")]

    asyncio.run(see())


def test_a_queue_of_another_host_is_shown_and_not_touched(tmp_path: Path) -> None:
    async def see() -> None:
        hands = Hands()
        here, there = RunQueue(tmp_path, "pc", now=hands), RunQueue(tmp_path, "other", now=hands)
        entry = await here.add(TOUCH, ADA)
        schedule = await here.add_schedule(CHECK, ADA, "6:30".zfill(5), (2,))
        hands.move(hours=1)
        await there.look(())
        assert states(there) == [("touch", "waiting")]
        for work in (there.remove(entry.id, ADA), there.remove_schedule(schedule.id, ADA)):
            with pytest.raises(InputError, match="use the console on pc"):
                await work

    asyncio.run(see())


@pytest.mark.parametrize(("at", "days"), [("25:00", (1,)), ("six", (1,)), ("06:00", ())])
def test_a_wrong_time_is_refused(tmp_path: Path, at: str, days: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"06:00|choose one"):
        asyncio.run(RunQueue(tmp_path, "pc").add_schedule(CHECK, ADA, at, days))
    assert not (tmp_path / FILE_NAME).exists()
