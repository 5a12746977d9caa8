"""The stream of events: resumed by the last id, reset where that is not possible, and never slowed by a client."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

import pytest

from cellctl.console.live.events import Event, EventStream, TooManyClients

T = TypeVar("T")


def run(work: Coroutine[Any, Any, T]) -> T:
    async def bounded() -> T:
        async with asyncio.timeout(30):
            return await work

    return asyncio.run(bounded())


async def now(stream: EventStream, last_id: str = "") -> list[Event]:
    return [event async for event in stream.listen(last_id, wait=False)]


def published(count: int, kept: int = 100) -> EventStream:
    stream = EventStream("a", kept)
    for number in range(count):
        stream.publish("run_step", run="r", step=str(number))
    return stream


def test_a_client_gets_every_event_after_its_last_one() -> None:
    async def see() -> list[Any]:
        stream = published(5)
        return [(event.id, event.data["step"]) for event in await now(stream, "a-3")]

    assert run(see()) == [("a-4", "3"), ("a-5", "4")]


@pytest.mark.parametrize("last_id", ["", "b-3", "a-99", "a-", "a-x", "a-²", "nonsense", "a-1"])
def test_a_client_whose_events_are_not_all_kept_has_to_read_the_state_anew(last_id: str) -> None:
    async def see() -> list[Any]:
        stream = published(5, kept=2)  # those after a-1 are gone
        return [(event.id, event.kind) for event in await now(stream, last_id)]

    assert run(see()) == [("a-5", "reset")]


def test_a_client_waits_and_gets_each_event_once() -> None:
    async def see() -> list[str]:
        stream, found = published(0), []

        async def read() -> None:
            async for event in stream.listen():
                found.append(event.kind)
                if event.kind == "run_ended":
                    return

        task = asyncio.create_task(read())
        for kind in ("run_started", "run_step", "run_ended"):
            await asyncio.sleep(0)
            stream.publish(kind)  # type: ignore[arg-type]
        await task
        return found

    assert run(see()) == ["reset", "run_started", "run_step", "run_ended"]


def test_a_client_that_is_slower_than_the_events_is_closed_and_others_are_not() -> None:
    async def see() -> tuple[list[str], list[str], int]:
        stream = published(0, kept=10)
        slow, quick = stream.listen(), stream.listen()
        first = [(await anext(slow)).id, (await anext(quick)).id]
        for number in range(25):
            stream.publish("run_step", number=number)
            first.append((await anext(quick)).id)
        return first, [event.id async for event in slow], stream.clients

    quick, slow, clients = run(see())
    assert quick == ["a-0", *(f"a-{number}" for number in range(26))]
    assert (slow, clients) == ([], 1)


def test_a_client_that_left_makes_room_for_another() -> None:
    async def see() -> None:
        stream = EventStream("a", most_clients=1)
        first = stream.listen()
        await anext(first)
        with pytest.raises(TooManyClients):
            await now(stream)
        await first.aclose()
        assert len(await now(stream)) == 1

    run(see())


def test_a_subscriber_that_fails_stops_neither_the_others_nor_the_stream() -> None:
    stream, found = EventStream("a"), []

    def fail(_: Event) -> None:
        raise RuntimeError("a subscriber")

    stream.subscribe(fail)
    stream.subscribe(lambda event: found.append(event.id))
    stream.publish("run_started")
    assert found == ["a-1"]
