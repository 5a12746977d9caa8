"""The proxy byte by byte, as the published protocol has it: variables, files, several clients, faults."""

from __future__ import annotations

import pytest


def test_bytes_of_reading_and_writing_are_those_of_the_protocol(bench):
    one = bench()
    one.client.sendall(b"\x12\x34\x00\x0c\x00\x00\x09$PERI_RD")
    one.client.sendall(b"Y")
    assert one.received(one.client, 14) == b"\x12\x34\x00\x0a\x00\x00\x04TRUE\x00\x01\x01"
    one.client.sendall(b"\x00\x01\x00\x12\x01\x00\x09$FLAG[12]\x00\x04TRUE")
    assert one.received(one.client, 14) == b"\x00\x01\x00\x0a\x01\x00\x04TRUE\x00\x01\x01"
    one.client.sendall(b"\x00\x02\x00\x0a\x00\x00\x07$NOBODY")
    assert one.received(one.client, 10) == b"\x00\x02\x00\x06\x00\x00\x00\x00\x00\x00"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("$MODE_OP", "#EX"),
        ("$PRO_STATE1", "#P_ACTIVE"),
        ("$pro_name1[]", '"/R1/CELLCTL_KVP()"'),
        ("$ROB_STOPPED", "TRUE"),
        ("$PERI_RDY", "TRUE"),
        ("$STOPMESS", "FALSE"),
        ("$V_R1MADA[]", '"V8.6.11"'),
        ("$ROBNAME[]", '"SIMULATED"'),
        ("KV_VERSION", "1"),
        ("KV_ALLOW_T1", "FALSE"),
        ("$FLAG[7]", "FALSE"),
        ("$FLAG[1024]", "FALSE"),
        ("$FLAG[1025]", None),
        ("$TIMER[64]", "0"),
        ("$TIMER[65]", None),
        ("KV_BANK[2].ID[]", '" "'),
        ("KV_TAB[3,500].C6", "0"),
        ("KV_TAB[3,501]", None),
        ("KV_TAB[3]", None),
        ("KV_JOB.WRONG", None),
        ("$SOFTN_END[7]", None),
        ("not a name", None),
    ],
)
def test_variables_are_read_as_the_controller_prints_them(bench, name, value):
    assert bench().read(name) == value


def test_values_are_checked_by_their_type_and_what_is_left_out_of_a_structure_stays(bench):
    one = bench()
    assert one.write("KV_JOB", "{KV_JOB_T: NUMBER 3, A1 -5, CHECK 2147483647}")
    assert one.write("kv_job", "{A2 12.6}")
    assert one.read("KV_JOB").startswith("{KV_JOB_T: NUMBER 3, ROW 0, PERCENT 0, A1 -5, A2 13, A3 0")
    for wrong in ("{A1 2147483648}", "{A1 x}", "{OTHER: A1 1}", "{A9 1}", "7", "{A1 1"):
        assert not one.write("KV_JOB", wrong), wrong
    assert not one.write("KV_BANK[1]", '{ID[] "' + 65 * "x" + '"}')
    assert not one.write("$MODE_OP", "#T1")
    assert one.read("KV_JOB.A1") == "-5"


def test_the_serial_is_marked_as_simulated_and_the_same_by_either_channel(bench):
    import random

    draw = random.Random("1 controller")
    draw.randrange(10_000, 1_000_000_000)
    assert bench().read("$KR_SERIALNO") == f'"SIM-{draw.randrange(10**6):06d}"'


def test_a_file_is_written_and_read_in_parts(bench):
    one = bench()
    name = "KRC:\\A.DAT"
    wide = len(name).to_bytes(2, "big") + name.encode("utf-16-le")
    four = [n.to_bytes(4, "big") for n in range(9)]
    assert one.ask(29, b"\x01" + four[5]) == (b"\x01" + four[5], 1, True)
    assert one.ask(29, b"\x02" + four[0] + four[3] + b"abc") == (b"\x02" + four[0] + four[3], 1, True)
    assert one.ask(29, b"\x02" + four[3] + four[8] + b"defghijk") == (b"\x02" + four[3] + four[2], 1, True)
    assert one.ask(29, b"\x04" + four[0] + wide)[2]
    assert one.ask(29, b"\x04" + four[0] + wide)[1:] == (2, False)
    assert one.ask(30, b"\x01" + four[0] + wide) == (b"\x01" + four[5], 1, True)
    assert one.ask(30, b"\x02" + four[1] + b"\xff\xff\xff\xff") == (b"\x02" + four[1] + four[4] + b"bcde", 1, True)
    assert one.ask(30, b"\x04")[2]
    assert one.ask(30, b"\x01" + four[0] + b"\x00\x01X\x00")[1:] == (0, False)


def test_an_answer_has_63_kibibytes_of_a_file_and_a_file_is_overwritten_with_64(bench):
    one = bench()
    path = b"\x00\x01A\x00"
    for size, flag in ((1, 0), (70_000, 64)):
        assert one.ask(29, b"\x01" + size.to_bytes(4, "big"))[2]
        for at in range(0, size, 35_000):
            part = bytes(min(35_000, size - at))
            assert one.ask(29, b"\x02" + at.to_bytes(4, "big") + len(part).to_bytes(4, "big") + part)[2]
        assert one.ask(29, b"\x04" + flag.to_bytes(4, "big") + path)[2]
    assert one.ask(30, b"\x01" + bytes(4) + path)[0] == b"\x01" + (70_000).to_bytes(4, "big")
    assert len(one.ask(30, b"\x02" + bytes(4) + b"\x00\x01\x11\x70")[0]) == 9 + 64_512


def test_kukavarproxy_has_no_files_and_none_of_the_bridges_variables(bench):
    one = bench(proxy="kukavarproxy")
    assert one.read("PING") == "PONG"
    assert one.read("@PROXY_TYPE") == ""
    one.client.sendall(b"\x00\x07\x00\x06\x1d\x01\x00\x00\x00\x05")
    assert one.received(one.client, 4) == b"\x00\x07\x00\x00"


def test_kukavarproxy_reads_what_there_is_not_as_an_empty_value_and_echoes_what_it_cannot_write(bench):
    one = bench(proxy="kukavarproxy")
    one.client.sendall(b"\x00\x02\x00\x0a\x00\x00\x07$NOBODY")
    assert one.received(one.client, 10) == b"\x00\x02\x00\x06\x00\x00\x00\x00\x01\x01"
    one.client.sendall(b"\x00\x03\x00\x10\x01\x00\x08$MODE_OP\x00\x03#T1")
    assert one.received(one.client, 13) == b"\x00\x03\x00\x09\x01\x00\x03#T1\x00\x01\x00"


def test_the_bridge_has_variables_of_its_own_and_hangs_up_at_a_type_that_it_does_not_know(bench):
    one = bench()
    assert [one.read(name) for name in ("PING", "@PROXY_TYPE")] == ["PONG", "C3 BRIDGE INTERFACE"]
    assert one.read("@PROXY_VERSION").endswith("(OPEN SOURCE)")
    one.client.sendall(b"\x00\x01\x00\x01\x02")
    assert one.received(one.client, 1) == b""


def test_a_request_shorter_than_it_says_is_refused_with_the_code_of_its_type(bench):
    one = bench()
    assert one.ask(0, b"\x00\x09short") == (b"\x00\x00", 0, False)
    assert one.ask(30, b"\x02\x00")[1:] == (9, False)
    four = [n.to_bytes(4, "big") for n in range(9)]
    assert one.ask(29, b"\x01" + four[5])[1:] == (1, True)
    assert one.ask(29, b"\x02" + four[0] + four[3] + b"a") == (b"\x02" + four[0] + four[3], 2, False)
    assert one.ask(29, b"\x05")[1:] == (7, False)
    assert one.ask(29, b"\x01\x01\x00\x00\x01")[1:] == (4, False)


def test_a_length_of_zero_ends_the_connection(bench):
    one = bench()
    one.client.sendall(bytes(4))
    assert one.received(one.client, 1) == b""


def test_requests_of_several_clients_are_done_one_after_another_each_after_its_delay(bench):
    one = bench(delay_least_ms=10, delay_most_ms=10)
    other = one.call()
    begun = one.kernel.now
    for client in (one.client, other):
        client.sendall(b"\x00\x01\x00\x0c\x00\x00\x09$STOPMESS")
    assert one.received(one.client, 15) == one.received(other, 15) == b"\x00\x01\x00\x0b\x00\x00\x05FALSE\x00\x01\x01"
    assert 20e6 <= one.kernel.now - begun < 60e6


def test_a_proxy_that_is_gone_hangs_up_and_is_back_at_the_same_port(bench):
    one = bench()
    begun = one.kernel.now
    one.fault("varproxy.gone", for_ms=2000)
    assert one.received(one.client, 1) == b""
    one.client = one.call()
    assert one.read("$STOPMESS") == "FALSE"
    assert one.kernel.now - begun >= 2e9


def test_faults_of_the_line(bench):
    one = bench()
    one.fault("varproxy.cut")
    one.client.sendall(b"\x00\x01\x00\x0c\x00\x00\x09$STOPMESS")
    assert one.received(one.client, 15) == b"\x00\x01\x00\x0b\x00\x00\x05"
    one.client = one.call()
    one.fault("varproxy.wrong_id", for_ms=30)
    one.client.sendall(b"\x00\x01\x00\x0c\x00\x00\x09$STOPMESS")
    assert one.received(one.client, 15)[:2] == b"\x00\x02"
    one.let_pass(0.1)
    assert one.read("$STOPMESS") == "FALSE"
    one.fault("varproxy.garbage", for_ms=30)
    one.client.sendall(b"\x00\x01\x00\x0c\x00\x00\x09$STOPMESS")
    assert one.received(one.client, 15) == b"\x00\x01\x00\x03 no message"
    one.let_pass(0.1)
    one.fault("varproxy.unloaded", for_ms=50)
    assert one.read("KV_GO") is None
    one.let_pass(0.1)
    assert one.read("KV_GO") == "0"
    begun = one.kernel.now
    one.fault("varproxy.slow", delay_ms=500, for_ms=100)
    assert one.read("$STOPMESS") == "FALSE"
    assert one.kernel.now - begun > 500e6
