"""A script of 200 events, drawn from a seed: the firmware and the simulated probe tell the same, at the same times."""

import random

import pytest

from drivers.contact_probe.lines import check_sum, encode
from tests.firmware.rigs import BROKEN, CLOSED, MS, OPEN, TICK_NS, US, SimulatorRig

EVENTS = 200
TICK_FIELDS = {"EDGE": 0, "CONF": 0, "OPEN": 0}
"""Which field is the tick of an edge."""
EDGE_WITHIN_NS = 2 * US
SAMPLES_NS = 110 * US
"""By a sample of the A/D converter more or less."""
STARTS_WITHIN_NS = 3 * MS
"""Of a line: in the firmware it may wait for an A/D sample and for one line more or less before it."""
CHANGING_NS = 3 * MS
KINDS = ("BOOT", "EDGE", "CONF", "OPEN", "FAULT", "ID", "SYNC", "RE")


def script(seed):
    """(ms to wait before, with the host there or not; what happens), event by event."""
    draw = random.Random(seed)

    def bounces(target):
        # the firmware may miss an edge within 10 µs of the one before: its interrupt turns the capture's direction
        times = sorted(draw.sample(range(30, 1500, 11), 2 * draw.randrange(3)))
        levels = [target, *[OPEN if target == CLOSED else CLOSED, target] * (len(times) // 2)]
        return ("levels", list(zip([0, *times], levels, strict=True)))

    events, seq = [], 0
    for _ in range(EVENTS):
        kind = draw.choices(
            ["ARM", "DISARM", "HELLO", "SYNC", "XYZZY", "again", "noise", "touch", "leave", "break", "mend", "range"],
            [16, 14, 1, 2, 1, 2, 2, 10, 14, 1, 4, 0.6],
        )[0]
        if kind == "touch":
            action = bounces(CLOSED)
        elif kind in {"leave", "mend"}:
            action = bounces(OPEN) if kind == "leave" else ("levels", [(0, OPEN)])
        elif kind == "break":
            action = ("levels", [(0, BROKEN)])
        elif kind == "range":
            action = ("levels", [(0, draw.choice([800, 3000]))])
        elif kind == "noise":
            action = ("bytes", draw.randbytes(draw.randrange(1, 150)).replace(b"\n", b"") + b"\n")
        elif kind == "XYZZY":
            body = b"XYZZY,%d,%d" % (60_000 + seq, draw.randrange(10**6))
            action = ("bytes", b"%s*%04X\n" % (body, check_sum(body)))
        else:
            seq += kind != "again"
            name = draw.choice(["ARM", "DISARM"]) if kind == "again" else kind
            action = ("bytes", encode(name, max(0, seq - 1)))
        silent = draw.random() < 0.04
        events.append((draw.choice([3.0, 8.0, 12.0, 30.0, 70.0, 650.0 if silent else 15.0]), not silent, action))
    return events


def play(probe, seed):
    draw = random.Random(seed + 1)
    probe.wait(60)
    for ms, host, (kind, what) in script(seed):
        probe.wait(ms + draw.randrange(10**6) / 1e6, host=host)
        if kind == "bytes":
            probe.put(what)
        else:
            for after_us, millivolts in what:
                probe.level(millivolts, probe.now + after_us * US)
            probe.wait(2)  # what comes next is after the last bounce
    probe.wait(300)
    return probe


def told(probe, kinds):
    """(kind, fields without ticks), and (edge's time or None, line's start) of each line, repetitions left out."""
    zero_ns = probe.sent[0].start_ns - probe.sent[0].line.tick * TICK_NS
    found = []
    for sent in probe.once(*kinds):
        fields, edge_ns = list(sent.fields), None
        if sent.kind in TICK_FIELDS:
            edge_ns = int(fields.pop(TICK_FIELDS[sent.kind])) * TICK_NS + zero_ns
        if sent.kind == "SYNC":
            fields.pop()
        if sent.kind == "ID":
            fields = [fields[0], fields[1], *fields[-2:]]  # not who it is
        found.append(((sent.kind, *fields), edge_ns, sent.start_ns))
    return found


def is_edge(time_ns, changes):
    """Whether the voltage changed then. An opening after `RANGE` has no edge: only A/D samples show it."""
    return min(abs(time_ns - change) for change in changes) <= EDGE_WITHIN_NS


def beats_differ(ours, theirs):
    """Heartbeats that differ, though neither the voltage nor the state has just changed or changes just then."""
    changes = [*theirs.changes, *(s.start_ns for s in theirs.sent if s.kind != "HB")]
    found = []
    for a, b in zip(ours.lines("HB"), theirs.lines("HB"), strict=True):
        (state, millivolts, host), (their_state, their_millivolts, their_host) = a.fields, b.fields
        near = any(abs(b.start_ns - change) < CHANGING_NS for change in changes)
        same = (state, host) == (their_state, their_host) and abs(int(millivolts) - int(their_millivolts)) <= 10
        if (not same and not near) or abs(a.start_ns - b.start_ns) > STARTS_WITHIN_NS:
            found.append((a.start_ns, b.start_ns, a.fields, b.fields))
    return found


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(2, 8))])
def test_a_script_of_two_hundred_events_is_told_alike(firmware, seed):
    probes = [play(firmware(), seed), play(SimulatorRig(), seed)]
    ours, theirs = (told(probe, KINDS) for probe in probes)
    assert [line for line, _, _ in ours] == [line for line, _, _ in theirs]
    edges = [(a, b) for (_, a, _), (_, b, _) in zip(ours, theirs, strict=True) if a is not None]
    changes = probes[1].changes
    assert all(abs(a - b) <= (EDGE_WITHIN_NS if is_edge(b, changes) else SAMPLES_NS) for a, b in edges)
    assert all(abs(a - b) <= STARTS_WITHIN_NS for (_, _, a), (_, _, b) in zip(ours, theirs, strict=True))
    assert beats_differ(*probes) == []
    contacts = probes[0].once("EDGE")
    assert len(contacts) >= 3
    assert {s.kind for s in probes[0].sent} == {*KINDS, "HB"}
    assert not probes[0].refused
