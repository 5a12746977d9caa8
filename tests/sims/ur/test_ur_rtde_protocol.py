"""RTDE as the maker's guide has it: versions, recipes of outputs and inputs, packages, their rate."""

from __future__ import annotations

import socket
import struct
from itertools import pairwise
from math import radians

import pytest

from sims.ur._rtde_fields import FORMATS
from tests.sims.ur.conftest import RTDE


def test_versions_1_and_2_are_there_and_3_is_not(bench):
    client = bench().rtde(version=1)
    assert [client.ask(b"V", struct.pack(">H", version)) for version in (1, 2, 3)] == [b"\x01", b"\x01", b"\x00"]


@pytest.mark.parametrize(("series", "version"), [("e", (5, 12, 4, 0)), ("cb3", (3, 15, 8, 0))])
def test_the_controller_states_its_version(bench, series, version):
    assert struct.unpack(">4I", bench(series=series).rtde().ask(b"v")) == version


def test_outputs_come_with_their_types_in_the_order_asked_for(bench):
    client = bench(errors={}).rtde()
    names = ("timestamp", "target_q", "actual_q", "robot_mode", "joint_mode", "runtime_state", "safety_status_bits")
    assert client.outputs(*names) == ["DOUBLE", "VECTOR6D", "VECTOR6D", "INT32", "VECTOR6INT32", "UINT32", "UINT32"]
    assert client.start()
    time, *rest = client.package()
    home = tuple(radians(angle) for angle in (0, -90, 90, -90, -90, 0))
    assert time > 0
    assert tuple(rest[:6]) == tuple(rest[6:12]) == pytest.approx(home)
    assert rest[12:] == [7, *[253] * 6, 1, 1]


def test_every_output_can_be_read(bench):
    begun = bench()
    client = begun.rtde()
    kinds = {name: kind for name, (kind, _) in begun.servers.rtde.outputs.items() if "bit_register_" not in name}
    names = list(kinds)
    for part in (names[i : i + 30] for i in range(0, len(names), 30)):
        client.ask(b"P")
        assert client.outputs(*part) == [kinds[name] for name in part]
        assert client.start()
        assert len(client.package()) == sum(int(FORMATS[kinds[name]][:-1] or 1) for name in part)


def test_an_unknown_name_is_not_found_and_there_is_no_recipe(bench):
    client = bench().rtde()
    assert client.outputs("timestamp", "no_such_output") == ["DOUBLE", "NOT_FOUND"]
    assert client.inputs("no_such_input") == (0, ["NOT_FOUND"])
    assert not client.start()


def test_an_input_belongs_to_one_client_until_it_is_gone(bench):
    begun = bench()
    first, second = begun.rtde(), begun.rtde()
    assert first.inputs("input_int_register_0", "input_double_register_3") == (1, ["INT32", "DOUBLE"])
    assert first.inputs("input_int_register_0") == (2, ["INT32"])
    assert second.inputs("input_int_register_0", "input_int_register_1") == (0, ["IN_USE", "INT32"])
    first.client.close()
    begun.let_pass(0.01)
    assert second.inputs("input_int_register_0") == (1, ["INT32"])


def test_inputs_take_effect(bench):
    begun = bench()
    client = begun.rtde()
    recipe, _ = client.inputs(
        "input_int_register_7", "input_double_register_47", "input_bit_registers32_to_63", "input_bit_register_64",
        "speed_slider_mask", "speed_slider_fraction", "standard_digital_output_mask", "standard_digital_output",
        "standard_analog_output_mask", "standard_analog_output_type", "standard_analog_output_1",
    )  # fmt: skip
    assert client.start()
    client.write(recipe, "idI?IdBBBBd", -5, 2.5, 5, True, 1, 0.25, 6, 2, 2, 2, 0.5)
    inputs = begun.board.inputs
    assert (inputs.ints[7], inputs.doubles[47], inputs.word(32), inputs.bits[64]) == (-5, 2.5, 5, True)
    assert (begun.motion.slider, begun.board.digital_out, begun.board.analog_value(1)) == (0.25, 2, 5.0)
    client.write(recipe, "idI?IdBBBBd", 1, 2.5, 5, True, 0, 0.75, 0, 0, 0, 0, 0.9)
    assert (begun.motion.slider, begun.board.digital_out, begun.board.analog_value(1)) == (0.25, 2, 5.0)


@pytest.mark.parametrize(("series", "hz", "step"), [("e", 500, 0.002), ("e", 100, 0.01), ("cb3", 125, 0.008)])
def test_packages_come_at_the_rate_asked_for(bench, series, hz, step):
    client = bench(series=series).rtde()
    client.outputs("timestamp", frequency=hz)
    client.start()
    times = [client.package()[0] for _ in range(5)]
    assert [b - a for a, b in pairwise(times)] == pytest.approx([step] * 4)


def test_version_1_has_no_rate_and_no_recipe_number(bench):
    client = bench(series="cb3").rtde(version=1)
    assert client.outputs("timestamp", "robot_mode") == ["DOUBLE", "INT32"]
    assert client.start()
    first, second = client.package(), client.package()
    assert second[0] - first[0] == pytest.approx(0.008)
    assert first[1] == 7


def test_a_pause_ends_the_packages_and_a_start_goes_on(bench):
    begun = bench()
    client = begun.rtde()
    client.outputs("timestamp")
    client.start()
    client.package()
    assert client.ask(b"P") == b"\x01"
    begun.let_pass(0.1)
    assert client.start()
    assert client.package()[0] > 0.1


def test_a_package_of_no_recipe_or_too_short_gets_a_text_message(bench):
    client = bench().rtde()
    client.send(b"U", b"\x07")
    assert client.receive()[0] == b"M"
    recipe, _ = client.inputs("input_double_register_0")
    client.send(b"U", bytes([recipe, 1, 2]))
    kind, content = client.receive()
    assert kind == b"M"
    assert b"wrong size" in content
    client.send(b"?")
    assert b"unknown package type" in client.receive()[1]


def test_a_size_below_that_of_a_head_ends_the_connection(bench):
    begun = bench()
    client = begun.call(RTDE)
    client.sendall(b"\x00\x02V")
    assert begun.received(client, 1) == b""


def test_the_probe_s_wire_is_at_its_input(bench):
    begun = bench(probe_input=9)
    client = begun.rtde()
    client.outputs("actual_digital_input_bits")
    client.start()
    assert client.package() == (0,)
    begun.scene.contact.set_closed(True)
    begun.let_pass(0.01)
    seen = [client.package()[0] for _ in range(8)]
    assert seen[-1] == 1 << 9


def test_somebody_who_touches_the_tip_closes_the_input_for_300_ms(bench):
    begun = bench(probe_input=9)
    begun.controller.requests["by_hand"]({"action": "touch"})
    assert begun.controller.digital_in() == 1 << 9
    begun.let_pass(0.29)
    assert begun.controller.digital_in() == 1 << 9
    begun.let_pass(0.02)
    assert begun.controller.digital_in() == 0


def test_a_client_that_does_not_read_loses_packages_and_is_not_hung_up_on(bench):
    begun = bench()
    client = begun.rtde()
    client.client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    size = 8 * len(client.outputs("timestamp", *["target_q"] * 150, frequency=500)) * 6
    client.start()
    (connection,) = begun.servers.ports[RTDE].connections
    begun.until(lambda: len(connection._unsent) > 0)
    begun.let_pass(1.0)
    assert connection.open
    assert 0 < len(connection._unsent) < size
    assert client.package()[0] < begun.controller.timestamp() - 1.0


def test_two_controllers_have_their_own_addresses(bench):
    first, second = bench(), bench()
    assert first.servers.host != second.servers.host
    assert all(host.startswith("127.") for host in (first.servers.host, second.servers.host))
    assert first.servers.address == f"ur+rtde://{first.servers.host}"
