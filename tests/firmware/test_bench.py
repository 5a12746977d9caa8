"""The bench behaves as the data sheet says of the chip where simavr alone does not: README.md, table of models."""

import pytest

from tests.firmware.firmware_kit.firmware_bench import BYTE_CYCLES, Bench
from tests.firmware.rigs import CLOSED, OPEN

CAPTURE_CYCLES = 8 + 3 + 4
"""Comparator, synchroniser with edge detector, noise canceller."""
TIMER_HZ_CYCLES = 8


class Chip:
    """The self-test's program, booted, with the loop open."""

    def __init__(self, images):
        self.bench = Bench(images.bench, images.selftest)
        self.bench.level(0, OPEN)
        self.events = self.run(10_000)
        self.hello = bytes(self.bytes())
        self.events.clear()

    def run(self, cycle):
        self.events = self.bench.run(cycle)
        return self.events

    def bytes(self):
        return [int(event.rest, 16) for event in self.events if event.kind == "tx"]


@pytest.fixture
def chip(images):
    chip = Chip(images)
    yield chip
    chip.bench.close()


def test_power_on_is_told_in_the_reset_flags(chip):
    assert chip.hello == b"R\x01"


@pytest.mark.parametrize(("cause", "flag"), [("EXTERNAL", 2), ("BROWNOUT", 4)])
def test_a_reset_is_told_in_the_reset_flags(chip, cause, flag):
    chip.bench.reset(20_000, cause)
    chip.run(30_000)
    assert bytes(chip.bytes()) == bytes([ord("R"), flag])


def test_the_watchdog_resets_a_program_that_hangs(chip):
    chip.bench.receive(20_000, b"w")
    chip.run(1_000_000)
    (reset,) = [event for event in chip.events if event.kind == "reset"]
    assert reset.cycle == pytest.approx(20_000 + 0.032 * 16e6, abs=2 * BYTE_CYCLES)  # 4096 cycles of 128 kHz
    assert bytes(chip.bytes()) == b"wR\x08"


def test_a_byte_takes_ten_bits_each_way(chip):
    chip.bench.receive(20_000, b"12")
    chip.run(40_000)
    first, second = [event.cycle for event in chip.events if event.kind == "tx"]
    assert 20_000 + 9 * 64 < first < 20_000 + 10 * 64 + 50
    assert second - first == pytest.approx(BYTE_CYCLES, abs=30)


def test_of_bytes_that_nobody_reads_two_are_kept_and_the_last_one(chip):
    chip.bench.receive(20_000, b"o123456789")
    chip.run(100_000)
    assert bytes(chip.bytes()) == b"o1!2!9" or bytes(chip.bytes()) == b"o12!9"
    assert len([event for event in chip.events if event.kind == "overrun"]) == 6


@pytest.mark.parametrize("phase", range(8))
def test_an_edge_is_captured_after_comparator_synchroniser_and_noise_canceller(chip, phase):
    captured = []
    for edge in (50_000 + phase, 90_000):
        chip.bench.level(edge, CLOSED)
        chip.bench.level(edge + 20_000, OPEN)
        chip.run(edge + 30_000)
        data = bytes(chip.bytes())
        assert data[:1] == b"C"
        assert len(data) == 3
        captured.append(int.from_bytes(data[1:], "big"))
    ticks = (90_000 + CAPTURE_CYCLES) // TIMER_HZ_CYCLES - (50_000 + phase + CAPTURE_CYCLES) // TIMER_HZ_CYCLES
    assert captured[1] - captured[0] == pytest.approx(ticks, abs=1)


@pytest.mark.parametrize(("cycles", "edges"), [(6, 0), (16, 1)])
def test_a_pulse_shorter_than_the_comparator_needs_is_none(chip, cycles, edges):
    chip.bench.level(50_000, CLOSED)
    chip.bench.level(50_000 + cycles, OPEN)
    chip.run(60_000)
    assert len(chip.bytes()) == 3 * edges


def test_a_flag_that_is_raised_while_its_interrupt_is_off_is_kept(chip):
    chip.bench.receive(20_000, b"s")
    chip.bench.level(30_000, CLOSED)
    chip.run(80_000)
    told = bytes(chip.bytes())
    assert told[:1] == b"s"
    assert told[1] & 0x20  # ICF1, though TOV1 was cleared meanwhile
    assert told[2:3] == b"C"


def test_the_converter_holds_the_voltage_of_its_sampling_time(chip):
    # first conversion: sample after 13.5 of 25 clocks of 128 cycles
    chip.bench.receive(20_000, b"a")
    chip.bench.level(20_000 + BYTE_CYCLES + 2_600, 3300)
    chip.run(40_000)
    assert int.from_bytes(bytes(chip.bytes())[1:], "big") == OPEN * 1024 // 5000


def test_memory_is_full_of_a_pattern_at_power_on(chip):
    assert chip.bench.memory(0x400, 16) == b"\xa5" * 16
