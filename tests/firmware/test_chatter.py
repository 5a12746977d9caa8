"""A loop at the comparator's threshold: it chatters, and the probe goes on speaking."""

from itertools import pairwise

import pytest

from tests.firmware.rigs import MS, OPEN, US


@pytest.mark.parametrize("every_us", [1, 3, 10, 40])
def test_a_chattering_comparator_is_an_undefined_voltage_and_delays_no_heartbeat(firmware, every_us):
    probe = firmware().armed()
    begin_ns, step_ns = probe.now, every_us * US
    for start_ns in range(begin_ns, begin_ns + 200 * MS, MS):
        for at_ns in range(start_ns, start_ns + MS, 2 * step_ns):
            probe.level(1080, at_ns)
            probe.level(1120, at_ns + step_ns)
        probe.wait(1)
    during = [sent for sent in probe.sent if sent.start_ns > begin_ns]
    probe.level(OPEN)
    probe.wait(300)
    assert next(sent.kind for sent in during) == "EDGE"
    assert {fault.fields[0] for fault in during if fault.kind == "FAULT"} == {"RANGE"}
    beats = [beat.start_ns for beat in during if beat.kind == "HB"]
    assert len(beats) == 4
    assert all(abs(late - early - 50 * MS) < 5 * MS for early, late in pairwise(beats))
    assert [time_ns for time_ns, on in probe.ok if begin_ns < time_ns < begin_ns + 200 * MS and on] == []
    assert len(probe.of_kind("reset")) == 1
    assert probe.ask("DISARM") == ["OK"]
    assert probe.ask("ARM") == ["OK"]
