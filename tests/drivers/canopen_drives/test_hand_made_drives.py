"""The driver against drives made by hand, byte by byte, on a `virtual` bus in real time."""

import asyncio
import struct

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, DeviceFault, DeviceLost, DeviceRefused, DeviceUnreachable, Surroundings
from cellctl.devices.registry import DriverRegistry


def test_the_set_up_has_the_order_that_drives_need(on_bus):
    async def story(bus, drives):
        await drives.connect()
        assert bus.drives[2].written == [
            (0x1800, 1, 0x80000182),
            (0x1A00, 0, 0),
            (0x1A00, 1, 0x60640020),
            (0x1A00, 2, 0x60780010),
            (0x1A00, 3, 0x60770010),
            (0x1A00, 0, 3),
            (0x1800, 2, 1),
            (0x1800, 1, 0x182),
            (0x1017, 0, 1000),
        ]

    on_bus(story)


def test_the_identity_names_all_drives(on_bus):
    async def story(bus, drives):
        identity = await drives.connect()
        assert (identity.model, identity.firmware, identity.serial) == ("2 × HAND", "1.2", "41,42")
        assert not identity.simulated

    on_bus(story)


@pytest.mark.parametrize(
    ("setting", "amperes"),
    [("", 0.5), ("&current=6078", 0.5), ("&current=6077", -1.0), ("&current=6077/sqrt2", -0.7071067811865)],
)
def test_per_mille_of_the_rated_current_become_amperes_by_the_object_that_the_address_names(on_bus, setting, amperes):
    async def story(bus, drives):
        bus.drives[1].current, bus.drives[1].torque = 100, -200
        await drives.connect()
        assert (await drives.currents(3)).amperes[0] == pytest.approx(amperes)

    on_bus(story, settings=setting)


def test_the_mean_and_scatter_of_the_samples_are_reported_in_the_order_of_the_axes(on_bus):
    async def story(bus, drives):
        values = iter([100, 110, 120, 130])

        def next_value():
            bus.drives[7].current = next(values)

        bus.on_sync = next_value
        bus.drives[3].current = -400
        await drives.connect()
        found = await drives.currents(4)
        assert found.amperes == pytest.approx((0.575, -2.0))
        assert found.sigma_a == pytest.approx((0.0645, 0.00144), abs=1e-3)
        assert found.samples == 4

    on_bus(story, nodes=(7, 3))


def test_rated_values_of_zero_are_refused(on_bus):
    async def story(bus, drives):
        bus.drives[2].objects[0x6075, 0] = bytes(4)
        with pytest.raises(DeviceFault, match=r"A2 \(node 2\) has a rated current of 0 mA"):
            await drives.connect()

    on_bus(story)


def test_a_missing_node_is_named(on_bus):
    async def story(bus, drives):
        bus.drives[2].dead = True
        with pytest.raises(DeviceUnreachable, match=r"node 2 of 2 on virtual .* did not answer"):
            await drives.connect()

    on_bus(story)


def test_a_node_that_is_no_drive_is_refused(on_bus):
    async def story(bus, drives):
        bus.drives[1].objects[0x1000, 0] = struct.pack("<I", 401)
        with pytest.raises(DeviceRefused, match=r"A1 \(node 1\) has profile 401, it is no drive"):
            await drives.connect()

    on_bus(story)


def test_a_drive_without_optional_texts_is_taken(on_bus):
    async def story(bus, drives):
        for place in ((0x1008, 0), (0x100A, 0), (0x1018, 4)):
            del bus.drives[1].objects[place]
        assert (await drives.connect()).serial == ",42"

    on_bus(story)


def test_an_object_that_a_drive_lacks_is_named(on_bus):
    async def story(bus, drives):
        del bus.drives[1].objects[0x6076, 0]
        with pytest.raises(DeviceRefused, match=r"A1 \(node 1\): object 0x6076:0 cannot be read"):
            await drives.connect()

    on_bus(story)


def test_a_drive_that_falls_silent_is_named(on_bus):
    async def story(bus, drives):
        await drives.connect()
        bus.drives[2].answers = 0
        with pytest.raises(DeviceLost, match=r"A2 \(node 2\) is silent: no answer to SYNC"):
            await drives.currents(2)
        bus.drives[2].answers = 1
        assert (await drives.currents(2)).samples == 2

    on_bus(story)


def test_a_boot_up_in_the_middle_of_sampling_is_a_fault_until_the_next_connection(on_bus):
    async def story(bus, drives):
        await drives.connect()

        def reboot():
            bus.drives[1].state = 127
            bus.send(*bus.drives[1].heartbeat(0))

        bus.on_sync = reboot
        for _ in range(2):
            with pytest.raises(DeviceFault, match=r"A1 \(node 1\) has restarted") as caught:
                await drives.currents(5)
        assert "connect again" in caught.value.cure
        assert not (await drives.health()).ok
        bus.on_sync = lambda: None
        await drives.connect()
        assert (await drives.currents(2)).samples == 2

    on_bus(story)


def test_a_drive_that_is_stopped_by_somebody_is_a_fault(on_bus):
    async def story(bus, drives):
        await drives.connect()
        bus.on_sync = lambda: bus.send(*bus.drives[2].heartbeat(4))
        bus.drives[2].answers = 0
        with pytest.raises(DeviceFault, match=r"A2 \(node 2\) is stopped while it was in use"):
            await drives.currents(1)

    on_bus(story)


def test_an_emcy_ends_sampling_and_shows_in_the_health_until_it_is_taken_back(on_bus):
    async def story(bus, drives):
        await drives.connect()
        bus.on_sync = lambda: bus.send(0x082, b"\x10\x43\x09\0\0\0\0\0")
        bus.drives[2].answers = 0
        with pytest.raises(DeviceFault, match=r"A2 \(node 2\) reports a fault: EMCY 0x4310 \(Temperature\)"):
            await drives.currents(1)
        health = await drives.health()
        assert not health.ok
        assert "EMCY 0x4310" in health.text
        assert health.figures["emergencies"] == 1
        bus.on_sync, bus.drives[2].answers = lambda: bus.send(0x082, bytes(8)), 1
        with pytest.raises(DeviceFault):
            await drives.currents(1)
        bus.send(0x082, bytes(8))
        await drives._clock.sleep(0.3)
        assert (await drives.health()).ok

    on_bus(story)


@pytest.mark.parametrize(
    ("statusword", "error", "what"),
    [
        (0x0233, DeviceRefused, r"A1 \(node 1\) is in 'switched on': its brake is closed"),
        (0x0250, DeviceRefused, r"A1 \(node 1\) is in 'switch on disabled'"),
        (0x0208, DeviceFault, r"A1 \(node 1\) is at fault, error code 0x7305"),
    ],
)
def test_currents_of_a_drive_that_is_not_in_operation_are_refused(on_bus, statusword, error, what):
    async def story(bus, drives):
        await drives.connect()
        bus.drives[1].objects[0x6041, 0] = struct.pack("<H", statusword)
        bus.drives[1].objects[0x603F, 0] = struct.pack("<H", 0x7305)
        with pytest.raises(error, match=what):
            await drives.currents(1)

    on_bus(story)


def test_two_frames_for_one_sync_show_another_master(on_bus):
    async def story(bus, drives):
        await drives.connect()
        bus.drives[1].answers = 2
        with pytest.raises(DeviceFault, match="sends process data without our SYNC"):
            await drives.currents(3)

    on_bus(story)


def test_frames_that_are_too_short_are_counted_and_passed_over(on_bus):
    async def story(bus, drives):
        await drives.connect()
        for can_id in (0x181, 0x081, 0x701):
            bus.send(can_id, b"")
        await drives._clock.sleep(0.3)
        assert (await drives.currents(2)).samples == 2
        assert (await drives.health()).figures["unreadable"] == 3

    on_bus(story)


def test_no_samples_are_an_error_of_the_caller_and_nothing_works_without_a_connection(on_bus):
    async def story(bus, drives):
        with pytest.raises(DeviceLost, match="not connected"):
            await drives.currents(1)
        with pytest.raises(DeviceLost, match="not connected"):
            await drives.health()
        await drives.stop()
        await drives.connect()
        with pytest.raises(ValueError, match="0 samples"):
            await drives.currents(0)

    on_bus(story)


def test_a_bus_that_is_not_there_is_reported_with_its_cure(tmp_path):
    async def go():
        address = Address.parse("canopen+socketcan://can0?nodes=1")
        drives = DriverRegistry().open("drives", address, Surroundings(WallClock(), tmp_path, {}, None))
        with pytest.raises(DeviceUnreachable, match="the CAN bus socketcan can0 cannot be opened") as caught:
            await drives.connect()
        assert "ip link set can0 up" in caught.value.cure

    asyncio.run(go())
