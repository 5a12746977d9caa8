"""The simulated drives, frame by frame: NMT, SDO, mapping, SYNC, heartbeat, EMCY, faults, and the true currents."""

import struct
from dataclasses import replace

import pytest

from sims.bench import catalogue, setup_of
from sims.drives._server import DriveServer
from sims.faults import Faults
from sims.simulator import CannotStart
from tests.helpers.sims import read_fault

MAPPING = (0x60640020, 0x60780010, 0x60770010)
NOT_NOW = 0x08000022


def test_boot_up_is_the_first_frame_after_a_reset_and_process_data_stop(bench):
    bench.map(1, *MAPPING)
    bench.send(0x000, 0x01, 1)
    assert [can_id for can_id, _ in bench.ask(0x080)] == [0x181]
    bench.send(0x000, 0x81, 1)
    assert bench.run(600.0) == [(0x701, b"\x00")]
    assert bench.ask(0x080) == []


def test_a_node_shows_its_identity_and_rated_values(bench):
    assert bench.read(2, 0x1000) & 0xFFFF == 402
    rated = bench.scene.world.motors.rated_a
    assert bench.read(2, 0x6075) == round(1e3 * rated[1])
    assert bench.read(2, 0x6076) == round(400.0 * rated[1])
    assert bench.read(2, 0x1018, 4) == 1002
    assert text_of(bench, 0x1008) == b"SIM CiA 402 drive"
    assert text_of(bench, 0x100A) == b"SIM 1.0"


def text_of(bench, index):
    """An object of node 2 that is longer than four bytes: it comes in segments."""
    ((_, answer),) = bench.ask(0x602, 0x40, index & 0xFF, index >> 8, 0, 0, 0, 0, 0)
    size = int.from_bytes(answer[4:8], "little")
    text, toggle = b"", 0
    while len(text) < size:
        ((_, segment),) = bench.ask(0x602, 0x60 | toggle, 0, 0, 0, 0, 0, 0, 0)
        text, toggle = text + segment[1 : 8 - (segment[0] >> 1 & 7)], toggle ^ 0x10
    return text


def test_a_node_is_delivered_with_the_statusword_in_its_first_pdo_and_the_second_off(bench):
    assert bench.read(2, 0x1400, 1) == 0x202
    assert bench.read(2, 0x1600, 1) == 0x60400010
    assert (bench.read(2, 0x1800, 1), bench.read(2, 0x1800, 2)) == (0x182, 1)
    assert (bench.read(2, 0x1A00), bench.read(2, 0x1A00, 1)) == (1, 0x60410010)
    assert bench.read(2, 0x1801, 1) == 0x80000282
    assert (bench.read(2, 0x1A01), bench.read(2, 0x1A01, 1)) == (1, 0x60410010)


def test_an_sdo_transfer_takes_no_time_of_the_cell(bench):
    before = bench.kernel.now
    bench.send(0x601, 0x40, 0x75, 0x60, 0, 0, 0, 0, 0)
    ((_, answer),) = bench.run(0.0)
    assert answer[:4] == bytes([0x43, 0x75, 0x60, 0])
    assert bench.kernel.now == before


def test_an_unknown_object_and_a_constant_are_refused(bench):
    ((_, answer),) = bench.ask(0x601, 0x40, 0x99, 0x99, 0, 0, 0, 0, 0)
    assert answer == bytes([0x80, 0x99, 0x99, 0]) + struct.pack("<I", 0x06020000)
    assert bench.write(1, 0x6075, 0, 5000, 4) == 0x06010002


def test_the_usual_order_of_mapping_is_taken(bench):
    assert bench.map(1, *MAPPING) == [0] * 8


@pytest.mark.parametrize(
    ("steps", "code"),
    [
        ([(0x1A00, 0, 0, 1)], NOT_NOW),  # still valid
        ([(0x1800, 2, 1, 1)], NOT_NOW),
        ([(0x1800, 1, 0x80000181, 4), (0x1A00, 1, 0x60640020, 4)], NOT_NOW),  # sub-index 0 is not 0
        ([(0x1800, 1, 0x80000181, 4), (0x1A00, 0, 0, 1), (0x1A00, 1, 0x60750020, 4)], 0x06040041),
        ([(0x1800, 1, 0x80000181, 4), (0x1800, 2, 255, 1)], 0x06090030),
        (
            [(0x1800, 1, 0x80000181, 4), (0x1A00, 0, 0, 1)]
            + [(0x1A00, entry, 0x60640020, 4) for entry in (1, 2, 3)]  # three times 4 bytes
            + [(0x1A00, 0, 3, 1)],
            0x06040042,
        ),
    ],
)
def test_another_order_or_content_is_refused(bench, steps, code):
    *before, last = [bench.write(1, *step) for step in steps]
    assert (before, last) == ([0] * len(before), code)


def test_mapping_is_refused_outside_pre_operational(bench):
    bench.send(0x000, 0x01, 0)
    assert bench.write(1, 0x1800, 1, 0x80000181, 4) == NOT_NOW


def test_a_node_sends_process_data_only_when_operational_and_only_for_a_sync(bench):
    for node in range(1, 7):
        bench.map(node, *MAPPING)
    assert bench.ask(0x080) == []
    bench.send(0x000, 0x01, 0)
    assert bench.run(100.0) == []
    assert [can_id for can_id, _ in bench.ask(0x080)] == [0x181, 0x182, 0x183, 0x184, 0x185, 0x186]


def test_every_third_sync_with_transmission_type_3(bench):
    bench.write(1, 0x1800, 1, 0x80000181, 4)
    bench.write(1, 0x1800, 2, 3, 1)
    bench.write(1, 0x1800, 1, 0x181, 4)
    bench.send(0x000, 0x01, 1)
    assert [len(bench.ask(0x080)) for _ in range(6)] == [0, 0, 1, 0, 0, 1]


def test_the_currents_are_the_true_ones_in_per_mille_of_the_rated_current(bench):
    for node in range(1, 7):
        bench.map(node, *MAPPING)
    bench.send(0x000, 0x01, 0)
    sums = [0.0] * 6
    for _ in range(100):
        for can_id, data in bench.ask(0x080):
            position, current, torque = struct.unpack("<ihh", data)
            assert position == round(1e4 * bench.scene.arm.readings()[can_id - 0x181])
            assert abs(torque - current) < 40  # two readings with noise: the torque is made of the current
            sums[can_id - 0x181] += current / 100.0
    rated, true = bench.scene.world.motors.rated_a, bench.scene.motor_currents()
    expected = [1e3 * amps / most for amps, most in zip(true, rated, strict=True)]
    assert sums == pytest.approx(expected, abs=4 * 4.1 / 10)
    assert max(map(abs, expected)) > 50.0


def test_all_drives_measure_at_the_sync_not_when_they_answer(bench):
    for node in (1, 2):
        bench.map(node, 0x60640020)
    bench.send(0x000, 0x01, 0)
    bench.scene.arm.move((30.0, -60.0, 90.0, 0.0, 45.0, 0.0), 100.0, lambda: None)
    bench.run(300.0)
    at = bench.kernel.now
    frames = dict(bench.ask(0x080))
    joints, _ = bench.scene.arm.joints_at(at)
    found = [int.from_bytes(frames[0x180 + node], "little", signed=True) for node in (1, 2)]
    assert found == [round(1e4 * joint) for joint in joints[:2]]


def test_a_closed_brake_shows_in_the_statusword_and_the_current_is_zero(bench):
    assert bench.read(1, 0x6041) & 0x6F == 0x27
    bench.scene.currents.brakes_after_ns = 300_000_000
    bench.run(300.0)
    assert bench.read(1, 0x6041) & 0x6F == 0x23
    assert bench.read(2, 0x6078) == 0
    bench.scene.arm.move((1.0, -90.0, 90.0, 0.0, 45.0, 0.0), 100.0, lambda: None)
    assert bench.read(1, 0x6041) & 0x6F == 0x27
    assert bench.read(2, 0x6078) != 0


def test_a_master_can_take_the_power_off_a_drive_by_sdo_and_by_rpdo(bench):
    assert bench.write(1, 0x6040, 0, 0x00, 2) == 0
    assert bench.read(1, 0x6041) & 0x4F == 0x40
    bench.send(0x000, 0x01, 0)
    bench.send(0x202, 0x02, 0x00)
    assert bench.read(2, 0x6041) & 0x6F == 0x07
    assert bench.read(3, 0x6041) & 0x6F == 0x27


def test_heartbeats_come_in_the_cells_time_and_show_the_state(bench):
    for node in (1, 2):
        bench.send(0x600 + node, 0x2B, 0x17, 0x10, 0, 100, 0, 0, 0)
    assert bench.run(350.0).count((0x701, b"\x7f")) == 4
    bench.send(0x000, 0x01, 1)
    found = bench.run(100.0)
    assert (0x701, b"\x05") in found
    assert (0x702, b"\x7f") in found
    bench.send(0x601, 0x2B, 0x17, 0x10, 0, 0, 0, 0, 0)
    bench.run()
    assert {can_id for can_id, _ in bench.run(500.0)} == {0x702}


def test_a_fault_is_sent_as_emcy_and_ends_with_its_reset(bench):
    bench.faults.schedule(read_fault({"fault": "drives.emcy", "node": 3, "code": 0x4310}))
    assert bench.run() == [(0x083, b"\x10\x43\x01\0\0\0\0\0")]
    assert (bench.read(3, 0x603F), bench.read(3, 0x1001)) == (0x4310, 1)
    assert bench.read(3, 0x6041) & 0x4F == 0x08
    bench.send(0x603, 0x2B, 0x40, 0x60, 0, 0x80, 0, 0, 0)
    assert (0x083, bytes(8)) in bench.run()
    assert (bench.read(3, 0x603F), bench.read(3, 0x1001)) == (0, 0)


def test_a_silent_drive_sends_nothing_the_others_go_on(bench):
    for node in (1, 2):
        bench.map(node, *MAPPING)
    bench.send(0x000, 0x01, 0)
    bench.faults.schedule(read_fault({"fault": "drives.silent", "node": 1, "for_ms": 50}))
    bench.run()
    assert [can_id for can_id, _ in bench.ask(0x080) if can_id < 0x183] == [0x182]
    bench.run(100.0)
    assert [can_id for can_id, _ in bench.ask(0x080) if can_id < 0x183] == [0x181, 0x182]


def test_a_drive_that_reboots_has_lost_its_mapping_and_is_pre_operational(bench):
    bench.map(1, *MAPPING)
    bench.send(0x000, 0x01, 1)
    bench.faults.schedule(read_fault({"fault": "drives.reboot", "node": 1}))
    assert bench.run(600.0) == [(0x701, b"\x00")]
    assert bench.read(1, 0x1A00) == 1
    assert bench.ask(0x080) == []


def test_a_datagram_that_is_no_frame_is_passed_over(bench):
    bench.bus._multicast.send(b"\xff\x00garbage")
    bench.run()
    assert bench.read(1, 0x1000) & 0xFFFF == 402


def test_the_wire_counts_the_drives_frames_and_the_masters_frames(bench):
    bench.run()
    bench.send(0x000, 0x80, 1)  # a session begins: both counts from here
    before = bench.wire.written
    bench.read(1, 0x1000)
    assert bench.wire.written - before == 1
    assert bench.wire.has_read(2)
    assert not bench.wire.has_read(3)


@pytest.mark.parametrize(
    ("nodes", "fault", "what"),
    [
        ("1,2,3", None, r"3 nodes, and the robot has 6 axes"),
        ("1,2,3,4,5,6", {"fault": "drives.emcy", "node": 9}, r"drives\.emcy: there is no node 9"),
    ],
)
def test_a_cell_file_that_does_not_fit_is_refused(cell, kernel, nodes, fault, what):
    simulate = replace(cell.simulate, faults=(read_fault(fault),) if fault else ())
    cell = replace(cell, addresses={"drives": f"canopen+socketcan://can0?nodes={nodes}"}, simulate=simulate)
    with pytest.raises(CannotStart, match=what):
        DriveServer(setup_of(cell, "drives", kernel, Faults(kernel, catalogue())))
