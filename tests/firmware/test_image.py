"""The built firmware: the same bytes as the committed file, and memory to spare."""

import os
import subprocess

import pytest

from drivers.contact_probe.lines import encode
from tests.firmware.conftest import HERE, REQUIRED
from tests.firmware.rigs import BROKEN, CLOSED, OPEN
from tests.helpers.runs import ROOT

FIRMWARE = ROOT / "drivers" / "contact_probe" / "firmware"
COMPILER = "5.4.0"
"""That of Debian's gcc-avr, with which the committed file is built; another one gives other bytes."""
RAM = range(0x100, 0x900)
SPARE = 256
"""Bytes of RAM that nothing has ever written."""


def test_the_committed_hex_file_is_what_the_sources_give(images, tmp_path):
    version = subprocess.run(["avr-gcc", "-dumpversion"], capture_output=True, text=True, check=True).stdout.strip()
    if version != COMPILER and os.environ.get(REQUIRED) != "required":
        pytest.skip(f"the committed file is of avr-gcc {COMPILER}; here is {version}")
    subprocess.run(["make", "-s", "-C", FIRMWARE, f"BUILD={tmp_path}"], check=True)
    assert (tmp_path / "contact_probe.hex").read_bytes() == (FIRMWARE / "contact_probe.hex").read_bytes()
    assert (tmp_path / "contact_probe.hex").read_bytes() == (HERE / "build" / "contact_probe.hex").read_bytes()


def test_the_stack_stays_clear_of_the_variables(firmware):
    probe = firmware().armed()
    for number in range(30):
        probe.put((encode("SYNC", number) + b"XYZZY" * 20 + encode("HELLO", number)) * 4)
        for step, millivolts in enumerate((CLOSED, OPEN, CLOSED, OPEN, 800, BROKEN, OPEN)):
            probe.level(millivolts, probe.now + step * 700_000)
        probe.wait(20, host=number % 2 == 0)
        probe.put(encode("DISARM", 500 + number) + encode("ARM", 600 + number))
        probe.wait(40)
    memory = probe.bench.memory(RAM.start, len(RAM))
    longest = max(len(run) for run in "".join("x" if byte == 0xA5 else " " for byte in memory).split())
    print(f"{longest} of {len(memory)} bytes of RAM are never written")
    assert longest >= SPARE
