"""The simulator as a program of somebody else would find it on its line."""

import os
import select
from pathlib import Path
from urllib.parse import urlsplit

import dial_gauge
import pytest

from sims.bench import Bench

CELL = Path(dial_gauge.__file__).parent / "cells" / "dial_gauge_cell.yaml"


@pytest.fixture
def bench():
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def line(bench):
    gauge = bench.start(CELL, "gauge")
    line = os.open(urlsplit(gauge.address).path, os.O_RDWR | os.O_NOCTTY)
    yield line
    os.close(line)


def test_it_tells_a_serial_number_that_marks_it_as_simulated(bench, line):
    os.write(line, b"ID?\r")
    assert bench.received(line, 12) == b"SIM-GAUGE-1\r"


def test_its_reading_drifts_by_what_the_cell_file_says(bench, line):
    bench.let_pass(600.0)
    before = bench.kernel.now
    os.write(line, b"?\r")
    reading = float(bench.received(line, 7))
    mm_per_ns = 0.01 / 60e9
    assert before * mm_per_ns - 0.005 < reading < bench.kernel.now * mm_per_ns + 0.005


def test_while_its_fault_is_on_it_answers_nothing(bench, line):
    bench.fault("dial_gauge.silent")
    os.write(line, b"?\r")
    bench.until(lambda: bench.faults.counts["dial_gauge.read"])
    assert select.select([line], [], [], 0.1)[0] == []
