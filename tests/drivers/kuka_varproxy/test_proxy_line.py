"""The connection against a bare server of the test's own: any doubt about an answer ends it."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import pytest

from cellctl.clock import WallClock
from cellctl.devices import DeviceFault, DeviceLost, DeviceRefused, DeviceUnreachable
from drivers.kuka_varproxy.line import ProxyLine
from drivers.kuka_varproxy.variables import Variables

GOOD = b"\x00\x01\x00\x06\x00\x00\x02" + b"50" + b"\x00\x01\x01"
GOOD = GOOD[:2] + (len(GOOD) - 4).to_bytes(2, "big") + GOOD[4:]


@asynccontextmanager
async def variables_behind(*answers):
    """Each request is answered by the next of `answers`; behind the last one the server hangs up."""
    asked = []

    async def serve(reader, writer):
        for answer in answers:
            head = await reader.readexactly(4)
            asked.append(head + await reader.readexactly(int.from_bytes(head[2:], "big")))
            for piece in answer if isinstance(answer, list) else [answer]:
                writer.write(piece)
                await writer.drain()
                await asyncio.sleep(0)
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    line = ProxyLine("robot", server.sockets[0].getsockname()[:2], WallClock())
    await line.open()
    try:
        yield Variables("robot", line), asked
    finally:
        await line.close()
        server.close()
        await server.wait_closed()


def read(*answers, name="$OV_PRO"):
    async def go():
        async with variables_behind(*answers) as (variables, asked):
            return await variables.read(name), asked

    return asyncio.run(go())


def test_a_variable_is_read_also_when_its_answer_comes_byte_by_byte():
    value, asked = read([bytes([byte]) for byte in GOOD])
    assert value == "50"
    assert asked == [b"\x00\x01\x00\x0a\x00\x00\x07$OV_PRO"]


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (b"\x00\x02" + GOOD[2:], "message 2 of type 0, which was not asked"),
        (GOOD[:4] + b"\x01" + GOOD[5:], "message 1 of type 1, which was not asked"),
        (b"\x00\x01\x00\x03garbage", "shortest"),
        (b"\x00\x01\x00\x00", "which was not asked"),
        (GOOD[:7], "closed the connection"),
    ],
    ids=["wrong id", "wrong type", "garbage", "no message", "cut in mid-message"],
)
def test_an_answer_in_doubt_ends_the_connection_and_the_cure_is_said(answer, said):
    with pytest.raises(DeviceLost, match=said) as caught:
        read(answer)
    assert "Make sure that the robot stands" in caught.value.cure


def test_after_a_doubt_nothing_is_sent_any_more():
    async def go():
        async with variables_behind(b"\x00\x09" + GOOD[2:], GOOD) as (variables, asked):
            for _ in range(2):
                with pytest.raises(DeviceLost):
                    await variables.read("$OV_PRO")
            return asked

    assert len(asyncio.run(go())) == 1


def test_a_variable_that_the_proxy_cannot_read_is_refused_with_a_cure():
    with pytest.raises(DeviceRefused, match=r"cannot read KV_GO \(code 0\)") as caught:
        read(b"\x00\x01\x00\x06\x00\x00\x00\x00\x00\x00", name="KV_GO")
    assert "cellctl krl" in caught.value.cure


def test_an_empty_value_is_a_variable_that_there_is_not_whatever_the_proxy_says_of_success():
    with pytest.raises(DeviceRefused, match=r"cannot read KV_GO"):
        read(b"\x00\x01\x00\x06\x00\x00\x00\x00\x01\x01", name="KV_GO")


def test_a_value_of_another_type_is_a_fault():
    async def go():
        async with variables_behind(GOOD.replace(b"50", b"#E")) as (variables, _):
            await variables.whole("KV_GO")

    with pytest.raises(DeviceFault, match="KV_GO makes no sense"):
        asyncio.run(go())


def test_a_name_that_is_not_ascii_is_not_sent():
    with pytest.raises(DeviceRefused, match="it was not sent"):
        read(name="µ")


def test_nobody_there_is_unreachable_and_the_cure_names_the_proxy():
    async def go():
        server = await asyncio.start_server(lambda r, w: None, "127.0.0.1", 0)
        place = server.sockets[0].getsockname()[:2]
        server.close()
        await server.wait_closed()
        await ProxyLine("robot", place, WallClock()).open()

    with pytest.raises(DeviceUnreachable, match="no variable proxy") as caught:
        asyncio.run(go())
    assert "proxy started" in caught.value.cure


def test_a_cancelled_request_does_not_bring_the_next_out_of_step():
    second = b"\x00\x02" + GOOD[2:].replace(b"50", b"60")

    async def go():
        async with variables_behind([], [GOOD, second]) as (variables, _):
            first = asyncio.create_task(variables.read("$OV_PRO"))
            await asyncio.sleep(0)
            first.cancel()
            return await variables.read("$OV_PRO")

    assert asyncio.run(go()) == "60"
