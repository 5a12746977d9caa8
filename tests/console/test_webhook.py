"""The webhook: what it sends, that it tries again, and that a dead receiver slows nothing."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable

import pytest

from cellctl.console.live.events import EventStream
from cellctl.console.webhook import Webhook, checked_url
from cellctl.files import InputError

Answer = Callable[[int], int]


def received(answer: Answer, see: Callable[[EventStream, Webhook], Awaitable[None]]) -> list[dict[str, object]]:
    """What a receiver got that answers the n-th request (from 0) with the status `answer(n)`; 0: it hangs up."""
    found: list[dict[str, object]] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().lower()
        length = int(head.partition("content-length:")[2].split()[0])
        found.append(json.loads(await reader.readexactly(length)))
        if status := answer(len(found) - 1):
            writer.write(f"HTTP/1.1 {status} x\r\ncontent-length: 0\r\nconnection: close\r\n\r\n".encode())
        writer.close()

    async def go() -> None:
        async with asyncio.timeout(30), await asyncio.start_server(serve, "127.0.0.1", 0) as server:
            port = server.sockets[0].getsockname()[1]
            stream, webhook = EventStream("a"), Webhook(f"http://127.0.0.1:{port}/key-7", "pc", [0.0, 0.01])
            stream.subscribe(webhook.put)
            task = asyncio.create_task(webhook.run())
            await see(stream, webhook)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    asyncio.run(go())
    return found


def test_alarms_ends_and_what_waits_are_posted_and_steps_are_not() -> None:
    got = asyncio.Event()

    def answer(number: int) -> int:
        if number == 1:
            got.set()
        return 204

    async def see(stream: EventStream, _: Webhook) -> None:
        stream.publish("run_step", run="r", step="touch")
        stream.publish("run_waits", **{"run": "r", "for": "Is the cell clear?"})
        stream.publish("run_waits", **{"run": "r", "for": ""})
        stream.publish("alarm_raised", what="r: failed")
        await got.wait()

    found = received(answer, see)
    assert [(one["event"], one["id"], one["host"]) for one in found] == [
        ("run_waits", "a-2", "pc"),
        ("alarm_raised", "a-4", "pc"),
    ]
    assert (found[0]["for"], found[1]["what"]) == ("Is the cell clear?", "r: failed")


def test_what_was_not_received_is_sent_again_and_given_up_without_the_address_in_the_log(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def see(stream: EventStream, webhook: Webhook) -> None:
        stream.publish("run_ended", run="first")
        stream.publish("run_ended", run="second")
        while webhook.dropped < 1:
            await asyncio.sleep(0.01)
        while len(found_runs) < 4:
            await asyncio.sleep(0.01)

    found_runs: list[int] = []

    def answer(number: int) -> int:
        found_runs.append(number)
        return (500, 0, 404, 200)[number]

    with caplog.at_level(logging.DEBUG, "cellctl"):
        found = received(answer, see)
    assert [one["run"] for one in found] == ["first", "first", "first", "second"]
    (line,) = [record.getMessage() for record in caplog.records if record.name.startswith("cellctl")]
    assert line == "the webhook did not receive run_ended: it answered 404"


def test_a_dead_receiver_slows_nothing_and_what_waits_is_bounded() -> None:
    async def see() -> int:
        stream, webhook = EventStream("a"), Webhook("http://127.0.0.1:9/", "pc")  # nobody listens, nothing is sent
        stream.subscribe(webhook.put)
        for number in range(150):
            stream.publish("run_ended", run=str(number))
        return webhook.dropped

    assert asyncio.run(see()) == 50


@pytest.mark.parametrize(
    "url", ["chat.example/s3cret", "ftp://x/s3cret", "http://", "http://x:0/s3cret", "http://[s3cret"]
)
def test_a_wrong_address_is_refused_without_being_shown(url: str) -> None:
    with pytest.raises(InputError) as error:
        checked_url(url)
    assert "s3cret" not in str(error.value)
