"""The PLC driver on the simulated PLC, over Modbus TCP, in lockstep."""

from __future__ import annotations

import pytest

from cellctl.devices import CellIO, DeviceFault, DeviceLost, DeviceRefused, DeviceUnreachable


async def until_lost(wire, limit_s=3.0):
    """Seconds of the cell's time until a condition raises DeviceLost, and the error."""
    began = wire.clock.now()
    while wire.clock.now() - began < limit_s:
        try:
            await wire.plc.holds("guard_closed")
        except DeviceLost as lost:
            return wire.clock.now() - began, lost
        await wire.let_pass(0.02)
    raise AssertionError(f"not lost within {limit_s} s")


def test_a_healthy_plc_reports_identity_inputs_temperatures_and_weather(on_wire):
    async def work(wire):
        plc = wire.plc
        assert isinstance(plc, CellIO)
        return wire.identity, await plc.inputs(), await plc.temperatures(), await plc.weather(), await plc.health()

    identity, inputs, temperatures, weather, health = on_wire(work)
    assert identity.simulated
    assert identity.serial.startswith("SIM-")
    assert identity.firmware == "1.0"
    assert inputs["emergency_stop_ok"]
    assert inputs["guard_closed"]
    assert inputs["clamped"]
    assert not inputs["unclamped"]
    assert temperatures.air == pytest.approx(20.0, abs=15.0)
    assert weather.pressure_hpa == pytest.approx(1013.0, abs=100.0)
    assert health.ok, health.text
    assert 5.0 <= health.figures["latency_ms"] <= 40.0


def test_whatever_heartbeat_the_plc_holds_from_before_a_new_connection_has_its_enable_at_once(on_wire):
    async def work(wire):
        enabled = []
        for stayed_s in (0.05, 0.45):
            await wire.let_pass(stayed_s)
            await wire.plc.close()
            await wire.let_pass(3.0)
            await wire.plc.connect()
            await wire.let_pass(0.15)
            enabled.append((await wire.plc.inputs())["drives_on"])
        return enabled

    assert on_wire(work) == [True, True]


def test_every_condition_can_be_asked_and_an_unknown_one_is_an_error(on_wire):
    async def work(wire):
        held = {name: await wire.plc.holds(name) for name in wire.plc.conditions()}
        with pytest.raises(KeyError):
            await wire.plc.holds("door")
        return held

    held = on_wire(work)
    assert held["alive"]
    assert held["temperatures_ok"]
    assert not held["maintenance_switch"]


def test_an_output_is_set_and_read_back_and_the_clamp_travels_from_one_end_to_the_other(on_wire):
    async def work(wire):
        plc, seen = wire.plc, []
        await plc.set_output("lamp_green", True)
        await plc.set_output("unclamp", True)
        for _ in range(8):
            await wire.let_pass(0.1)
            seen.append((await plc.holds("clamped"), await plc.holds("unclamped")))
        return seen

    seen = on_wire(work)
    assert (False, False) in seen  # on the way; not a fault of a sensor
    assert seen[-1] == (False, True)


def test_clamp_and_unclamp_are_never_set_together_and_an_unknown_output_is_an_error(on_wire):
    async def work(wire):
        await wire.plc.set_output("clamp", True)
        with pytest.raises(DeviceRefused, match="switch 'clamp' off first"):
            await wire.plc.set_output("unclamp", True)
        await wire.plc.set_output("clamp", False)
        await wire.plc.set_output("unclamp", True)
        with pytest.raises(KeyError):
            await wire.plc.set_output("emergency_stop", True)

    on_wire(work)


def test_emergency_stop_and_guard_are_reported_within_two_polls(on_wire):
    async def work(wire):
        await wire.fault("safety.emergency_stop", for_ms=500)
        await wire.let_pass(0.25)
        stopped = dict(await wire.plc.inputs())
        await wire.let_pass(0.6)
        await wire.fault("safety.guard_open", for_ms=500)
        await wire.let_pass(0.25)
        opened = dict(await wire.plc.inputs())
        await wire.let_pass(0.6)
        return stopped, opened, await wire.plc.inputs()

    stopped, opened, healthy = on_wire(work)
    names = ("emergency_stop_ok", "guard_closed", "safety_reset_required", "drives_on")
    assert [stopped[name] for name in names] == [False, True, True, False]
    assert [opened[name] for name in names] == [True, False, True, False]
    assert [healthy[name] for name in names] == [True, True, False, True]


def test_a_plc_that_is_gone_counts_as_unsafe_within_the_limit_and_is_found_again(on_wire):
    async def work(wire):
        await wire.let_pass(0.5)
        await wire.fault("plc.gone", for_ms=5000)
        seconds, lost = await until_lost(wire)
        with pytest.raises(DeviceLost):
            await wire.plc.temperatures()
        with pytest.raises(DeviceLost):
            await wire.plc.set_output("horn", True)
        await wire.let_pass(12.0)
        return seconds, str(lost), await wire.plc.holds("guard_closed"), await wire.plc.health()

    seconds, lost, holds, health = on_wire(work)
    assert seconds <= 0.6
    assert "closed the connection" in lost
    assert "check the network cable" in lost
    assert holds
    assert health.figures["reconnections"] == 1


def test_a_plc_whose_program_has_stopped_counts_as_unsafe(on_wire):
    async def work(wire):
        await wire.let_pass(0.5)
        await wire.fault("plc.stale", for_ms=3000)
        seconds, lost = await until_lost(wire)
        await wire.let_pass(3.0)
        return seconds, str(lost), await wire.plc.holds("alive")

    seconds, lost, alive = on_wire(work)
    assert seconds <= 1.3
    assert "its heartbeat counter has not changed" in lost
    assert "set the PLC to RUN" in lost
    assert alive


def test_a_broken_sensor_gives_no_temperature_no_weather_and_a_cure(on_wire):
    async def work(wire):
        await wire.fault("plc.sensor", sensor=1, for_ms=1000)
        await wire.let_pass(0.3)
        temperatures, ok = await wire.plc.temperatures(), await wire.plc.holds("temperatures_ok")
        with pytest.raises(DeviceFault, match="broken sensors: air temperature") as fault:
            await wire.plc.weather()
        health = await wire.plc.health()
        await wire.let_pass(1.0)
        return temperatures, ok, fault.value, health, await wire.plc.weather()

    temperatures, ok, fault, health, weather = on_wire(work)
    assert temperatures.air is None
    assert temperatures.arm is not None
    assert not ok
    assert "wire" in fault.cure
    assert not health.ok
    assert "air temperature" in health.text
    assert weather.temperature_c < 100.0


@pytest.mark.parametrize(("sensor", "name"), [(5, "pressure"), (6, "humidity")])
def test_weather_needs_pressure_and_humidity_too(on_wire, sensor, name):
    async def work(wire):
        await wire.fault("plc.sensor", sensor=sensor)
        await wire.let_pass(0.3)
        with pytest.raises(DeviceFault, match=name):
            await wire.plc.weather()
        return await wire.plc.temperatures()

    assert on_wire(work).air is not None


def test_clamp_sensors_that_contradict_each_other_are_a_fault(on_wire):
    async def work(wire):
        await wire.fault("plc.clamp")
        await wire.let_pass(0.3)
        for condition in ("clamped", "unclamped"):
            with pytest.raises(DeviceFault, match="clamped and unclamped at once"):
                await wire.plc.holds(condition)
        return await wire.plc.health()

    assert not on_wire(work).ok


def test_a_clamp_that_arrives_at_neither_end_is_a_fault(on_wire):
    async def work(wire):
        await wire.plc.set_output("unclamp", True)
        await wire.let_pass(1.6)
        with pytest.raises(DeviceFault, match="neither clamped nor unclamped"):
            await wire.plc.holds("clamped")

    on_wire(work, simulate="plc: {clamp_ms: 60000}")


def test_both_word_orders_give_the_same_uptime(on_wire):
    async def work(wire):
        return (await wire.plc.health()).figures["uptime_s"]

    assert on_wire(work) == on_wire(work, settings="&words=low_first")


def test_the_same_seed_gives_the_same_polls(on_wire):
    async def work(wire):
        found = []
        for _ in range(20):
            await wire.let_pass(0.07)
            found.append(((await wire.plc.temperatures()).time_ns, (await wire.plc.health()).figures["latency_ms"]))
        return found

    assert on_wire(work) == on_wire(work)


def test_another_unit_is_refused_with_the_cure(on_wire):
    async def work(wire):
        with pytest.raises(DeviceUnreachable, match="finds no PLC of this unit") as error:
            await wire.plc.connect()
        assert "check 'unit' in the address" in error.value.cure

    on_wire(work, driver_unit=7, connect=False)


def test_a_closed_device_is_lost_and_can_be_connected_again(on_wire):
    async def work(wire):
        await wire.plc.close()
        with pytest.raises(DeviceLost, match="connect it first"):
            await wire.plc.inputs()
        await wire.plc.connect()
        return await wire.plc.holds("alive")

    assert on_wire(work)


def test_connecting_again_at_once_is_the_same_in_every_run(on_wire):
    async def work(wire):
        moments = []
        for i in range(10):
            await wire.plc.close()
            await wire.plc.connect()
            await wire.let_pass(0.013 * i)
            moments.append(wire.clock.now_ns())
        return moments

    assert on_wire(work) == on_wire(work)
