"""The PLC driver against a scripted server: answers that are late, doubled, garbled, of another request, or missing."""

from __future__ import annotations

import asyncio
import struct
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, DeviceBusy, DeviceFault, DeviceLost, DeviceRefused, DeviceUnreachable, Surroundings
from drivers.modbus_plc import line
from drivers.modbus_plc.description import open_plc
from drivers.modbus_plc.line import ModbusLine

PATIENCE_S = 60.0


def frame(transaction, unit, pdu):
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


def healthy(pdu, counter):
    """What a healthy PLC answers, by hand."""
    match pdu[0]:
        case 2:
            return bytes((2, 2, 0b0010_0011, 0))
        case 4:
            return bytes((4, 22)) + struct.pack(">11H", 200, 200, 200, 200, 10132, 500, 600, counter, 0, 100, 0)
        case 6 | 5:
            return pdu
    return bytes((pdu[0] | 0x80, 1))


class Script:
    """A server; `replies(number, transaction, pdu)` gives the bytes to send; None: a healthy answer."""

    def __init__(self):
        self.replies = lambda number, transaction, pdu: None
        self.requests = []
        self.connections = 0

    async def talk(self, reader, writer):
        self.connections += 1
        with suppress(ConnectionError, asyncio.IncompleteReadError):
            while True:
                transaction, _, length, unit = struct.unpack(">HHHB", await reader.readexactly(7))
                pdu = await reader.readexactly(length - 1)
                self.requests.append(pdu)
                reply = self.replies(len(self.requests), transaction, pdu)
                if reply is None:
                    reply = frame(transaction, unit, healthy(pdu, len(self.requests)))
                for piece in reply if isinstance(reply, list) else [reply]:
                    writer.write(piece)
                    await writer.drain()
                    await asyncio.sleep(0.01)
        writer.close()

    def times(self, function):
        return sum(pdu[0] == function for pdu in self.requests)


@pytest.fixture
def served():
    @asynccontextmanager
    async def serve():
        script = Script()
        server = await asyncio.start_server(script.talk, "127.0.0.1", 0)
        script.port = server.sockets[0].getsockname()[1]
        try:
            yield script
        finally:
            server.close()

    return serve


def on_line(served, work, replies):
    """Runs `work(line, script)` on an open line."""

    async def go():
        async with asyncio.timeout(PATIENCE_S), served() as script:
            script.replies = replies
            one = ModbusLine("plc", "127.0.0.1", script.port, 1, WallClock())
            await one.open()
            try:
                return await work(one, script)
            finally:
                await one.close()

    return asyncio.run(go())


async def read(one):
    return (await one.ask("read", lambda c: c.read_input_registers(0, count=11, device_id=1))).registers


def test_an_answer_in_single_bytes_is_read_whole(served):
    async def work(one, script):
        return await read(one)

    def in_pieces(number, transaction, pdu):
        whole = frame(transaction, 1, healthy(pdu, 7))
        return [whole[i : i + 1] for i in range(len(whole))]

    assert on_line(served, work, in_pieces)[7] == 7


def test_the_answer_to_an_earlier_request_is_not_taken_for_this_one(served):
    async def work(one, script):
        return await read(one)

    def old_first(number, transaction, pdu):
        old = frame(transaction - 1 & 0xFFFF or 9, 1, healthy(pdu, 666))
        return [old, frame(transaction, 1, healthy(pdu, 7))]

    assert on_line(served, work, old_first)[7] == 7


def test_a_doubled_answer_does_not_answer_the_next_request(served):
    async def work(one, script):
        return (await read(one))[7], (await read(one))[7]

    def doubled(number, transaction, pdu):
        return frame(transaction, 1, healthy(pdu, number)) * 2

    assert on_line(served, work, doubled) == (1, 2)


def test_the_answer_of_another_unit_is_not_taken(served, monkeypatch):
    monkeypatch.setattr(line, "ANSWER_S", 0.2)

    async def work(one, script):
        with pytest.raises(DeviceLost, match="no answer"):
            await read(one)

    on_line(served, work, lambda number, transaction, pdu: frame(transaction, 2, healthy(pdu, 7)))


def test_a_write_without_an_answer_is_sent_once(served, monkeypatch):
    monkeypatch.setattr(line, "ANSWER_S", 0.2)

    async def work(one, script):
        with pytest.raises(DeviceLost, match="no answer within"):
            await one.ask("set 'horn'", lambda c: c.write_coil(6, True, device_id=1))
        with pytest.raises(DeviceLost):  # the line is of no more use
            await read(one)
        return script.times(5), script.times(4)

    assert on_line(served, work, lambda number, transaction, pdu: b"") == (1, 0)


@pytest.mark.parametrize(
    "garbage",
    [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\x00\x01\x00\x07\x00\x05\x01\x04\x02\x00\x00", b"\xff" * 600],
)
def test_garbage_ends_in_a_loss_and_not_in_values(served, monkeypatch, garbage):
    monkeypatch.setattr(line, "ANSWER_S", 0.2)

    async def work(one, script):
        with pytest.raises(DeviceLost):
            await read(one)

    on_line(served, work, lambda number, transaction, pdu: garbage)


def test_an_answer_that_cannot_be_decoded_ends_in_a_loss(served, monkeypatch):
    monkeypatch.setattr(line, "ANSWER_S", 0.5)

    async def work(one, script):
        with pytest.raises(DeviceLost):
            await read(one)

    on_line(served, work, lambda number, transaction, pdu: frame(transaction, 1, b"\x63\x00"))


@pytest.mark.parametrize(
    ("code", "kind", "words"),
    [
        (1, DeviceRefused, "does not know this function"),
        (2, DeviceRefused, "does not have this address"),
        (3, DeviceRefused, "does not take this value"),
        (4, DeviceFault, "failed"),
        (6, DeviceBusy, "busy"),
        (0x0A, DeviceLost, "unit"),
        (0x0B, DeviceLost, "unit"),
    ],
)
def test_every_exception_is_an_error_with_a_cure(served, code, kind, words):
    async def work(one, script):
        with pytest.raises(kind, match=words) as error:
            await read(one)
        return error.value

    def refused(number, transaction, pdu):
        return frame(transaction, 1, bytes((pdu[0] | 0x80, code)))

    assert on_line(served, work, refused).cure


def test_a_plc_without_identification_is_named_by_its_place(served):
    async def go():
        async with asyncio.timeout(PATIENCE_S), served() as script:
            plc = open_plc("plc", Address.parse(f"modbus+tcp://127.0.0.1:{script.port}"), around())
            identity = await plc.connect()
            await plc.close()
            return identity, script.port

    identity, port = asyncio.run(go())
    assert identity.serial == f"127.0.0.1:{port}"
    assert not identity.simulated


def test_the_pc_heartbeat_changes_with_each_poll(served):
    async def go():
        async with asyncio.timeout(PATIENCE_S), served() as script:
            plc = open_plc("plc", Address.parse(f"modbus+tcp://127.0.0.1:{script.port}"), around())
            await plc.connect()
            while script.times(6) < 5:
                await asyncio.sleep(0.02)
            await plc.close()
            return [pdu[4] for pdu in script.requests if pdu[0] == 6 and pdu[1:3] == b"\0\0"]

    beats = asyncio.run(go())
    assert beats[:5] == [1, 0, 1, 0, 1]


def test_nobody_at_the_address_is_unreachable_with_a_cure(served):
    async def go():
        async with asyncio.timeout(PATIENCE_S):
            async with served() as script:
                port = script.port
            plc = open_plc("plc", Address.parse(f"modbus+tcp://127.0.0.1:{port}"), around())
            with pytest.raises(DeviceUnreachable, match="no Modbus connection") as error:
                await plc.connect()
            return error.value

    assert "is the address right?" in asyncio.run(go()).cure


def around(**limits):
    return Surroundings(WallClock(), Path(), limits)


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("modbus+tcp://", "has to name a host"),
        ("modbus+tcp://plc/path", "no path"),
        ("modbus+tcp://plc?unit=x", "unit has to be"),
        ("modbus+tcp://plc?unit=256", "unit has to be"),
        ("modbus+tcp://plc?words=middle", "words has to be"),
        ("modbus+tcp://plc?speed=1", "'unit' and 'words'"),
    ],
)
def test_an_error_in_the_address_is_described(address, words):
    with pytest.raises(ValueError, match=words):
        open_plc("plc", Address.parse(address), around())


@pytest.mark.parametrize("limits", [{"age_s": 0.1}, {"age_s": 3.0}, {"heartbeat_s": 6.0}, {"poll_s": 0.5}])
def test_a_limit_that_is_unknown_or_too_high_is_refused(limits):
    with pytest.raises(ValueError, match="limit"):
        open_plc("plc", Address.parse("modbus+tcp://plc"), around(**limits))
