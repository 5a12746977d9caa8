"""Time on the serial line: characters one after another, the USB poll, and the host's lines."""

import pytest

from sims.probe._lines import Message, Receiver, Transmitter, framed

MS = 1_000_000


def run(kernel, ms):
    kernel.at(ms * MS, kernel.stop)
    kernel.run()


def transmitter(kernel, arrived, baud=250_000, grid_ns=0):
    return Transmitter(
        kernel, baud, grid_ns, lambda: kernel.now, lambda line, seq: arrived.append((kernel.now, seq, line))
    )


@pytest.mark.parametrize(("baud", "character_ns"), [(250_000, 40_000), (9_600, 1e7 / 9.6)])
def test_a_line_takes_ten_bits_a_character(kernel, baud, character_ns):
    arrived = []
    transmitter(kernel, arrived, baud).send(Message("HB", 3, ("ARMED", 1650, 1)))
    run(kernel, 60)
    ((at, _, line),) = arrived
    assert at == pytest.approx(len(line) * character_ns, abs=1)


def test_lines_follow_one_another_and_each_bears_the_tick_of_its_own_beginning(kernel):
    arrived = []
    wire = transmitter(kernel, arrived)
    wire.send(Message("EDGE", 1, (77,)))
    wire.send(Message("HB", 2, ("ARMED", 1650, 1)))
    run(kernel, 10)
    (first_at, _, first), (second_at, _, second) = arrived
    assert first.startswith(b"EDGE,1,0,77*")
    assert second.startswith(b"HB,2,%d,ARMED,1650,1*" % first_at)
    assert second_at == first_at + len(second) * 40_000


@pytest.mark.parametrize(("sent_ns", "arrives_ms"), [(0, 1), (300_000, 1), (1_000_000, 2)])
def test_an_adapter_gives_its_line_at_the_next_poll_of_the_cells_grid(kernel, sent_ns, arrives_ms):
    arrived = []
    wire = transmitter(kernel, arrived, baud=1_000_000, grid_ns=MS)
    kernel.at(sent_ns, lambda: wire.send(Message("EDGE", 1, (77,))))
    run(kernel, 5)
    assert [at for at, _, _ in arrived] == [arrives_ms * MS]


def test_a_line_that_still_waits_is_not_doubled_by_its_repetition(kernel):
    arrived = []
    wire = transmitter(kernel, arrived)
    for seq in (1, 2, 2):
        wire.send(Message("EDGE", seq, (77,)))
    run(kernel, 20)
    assert [seq for _, seq, _ in arrived] == [1, 2]


def test_what_is_not_out_when_the_power_goes_is_lost(kernel):
    arrived = []
    wire = transmitter(kernel, arrived)
    wire.send(Message("EDGE", 1, (77,)))
    wire.send(Message("EDGE", 2, (77,)))
    kernel.at(100_000, wire.cut)
    kernel.at(200_000, lambda: wire.send(Message("BOOT", 0, (1, "WATCHDOG"))))
    run(kernel, 20)
    assert [line[:6] for _, _, line in arrived] == [b"BOOT,0"]


def test_the_probe_hears_a_line_when_its_last_character_has_come(kernel):
    heard = []
    receiver = Receiver(kernel, 250_000, lambda line: heard.append((kernel.now, line)))
    one, two = framed("ACK,1"), framed("ARM,2")
    kernel.at(MS, lambda: receiver.feed(one + two[:3]))
    kernel.at(MS, lambda: receiver.feed(two[3:]))
    run(kernel, 5)
    ends = (MS + len(one) * 40_000, MS + len(one + two) * 40_000)
    assert heard == [(ends[0], one[:-1]), (ends[1], two[:-1])]


def test_the_host_side_learns_at_once_which_lines_it_has_completed(kernel):
    receiver = Receiver(kernel, 250_000, lambda line: None)
    assert receiver.feed(b"ACK,1*0") == []
    assert receiver.feed(b"000\nAC") == [b"ACK,1*0000"]
