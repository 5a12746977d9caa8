"""The driver on a line at whose other end the test answers, byte by byte."""

import asyncio
import os
import tty
from pathlib import Path

import pytest
from dial_gauge.driver import open_gauge

from cellctl.clock import WallClock
from cellctl.devices import Address, DeviceFault, DeviceLost, Surroundings


class Line:
    """The gauge's end of a line: it has written each answer when its question has come."""

    def __init__(self):
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.address = Address.parse(f"dial-gauge+serial://{os.ttyname(self._theirs)}")
        self.questions = []

    def answers(self, *texts):
        left = list(texts)

        def readable():
            self.questions.append(os.read(self._ours, 100))
            if left:
                os.write(self._ours, left.pop(0))

        asyncio.get_running_loop().add_reader(self._ours, readable)


def opened(address, **limits):
    return open_gauge("gauge", address, Surroundings(WallClock(), Path(), limits))


def read_once(line, *answers, **limits):
    async def all_of_it():
        line.answers(*answers)
        gauge = opened(line.address, **limits)
        identity = await gauge.connect()
        try:
            return identity, await gauge.length()
        finally:
            await gauge.close()

    return asyncio.run(all_of_it())


def test_the_reading_is_the_number_that_the_gauge_sends():
    line = Line()
    identity, length = read_once(line, b"12345\r", b"-0.274\r")
    assert (identity.serial, identity.simulated, length) == ("12345", False, -0.274)
    assert line.questions == [b"ID?\r", b"?\r"]


def test_an_answer_that_is_no_number_is_a_fault_of_the_gauge():
    with pytest.raises(DeviceFault, match="'ERR'"):
        read_once(Line(), b"12345\r", b"ERR\r")


def test_without_an_answer_within_the_limit_the_gauge_is_lost():
    with pytest.raises(DeviceLost, match="no answer"):
        read_once(Line(), b"12345\r", answer_s=0.05)


@pytest.mark.parametrize(("limits", "why"), [({"speed": 1.0}, "answer_s"), ({"answer_s": 60.0}, "at most 10")])
def test_a_limit_that_there_is_not_or_above_its_ceiling_is_refused(limits, why):
    with pytest.raises(ValueError, match=why):
        opened(Address.parse("dial-gauge+serial:///dev/ttyUSB0"), **limits)
