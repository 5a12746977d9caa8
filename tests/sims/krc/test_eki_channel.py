"""The transfer channel, byte for byte, against docs/reference/eki-channel.md."""

from __future__ import annotations

import re
import socket

import pytest

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
THERE = (10.0, -80.0, 90.0, 0.0, 45.0, 20.0)
FAR = (150.0, 60.0, 160.0, 300.0, 100.0, 300.0)
"""A quarter of an hour away at 0.1 %: with nobody to wait for, the cell's time may run on for minutes unasked."""


def body(target=THERE, percent="10.0"):
    axes = " ".join(f'A{i}="{angle:.4f}"' for i, angle in enumerate(target, 1))
    return f'<Vel P="{percent}"/><Q {axes}/>'


@pytest.mark.parametrize(
    ("rsi", "rsi_on"),
    [
        ({}, ' Correction="ABSOLUTE" Cycle="IPO_FAST"'),
        ({"mode": "relative", "cycle_ms": 12}, ' Correction="RELATIVE" Cycle="IPO"'),
        ({"hello": "short"}, ""),
    ],
)
def test_hello_tells_who_it_is_that_it_is_simulated_and_how_its_program_switches_rsi_on(bench, rsi, rsi_on):
    number, code, joints, text = bench(rsi=rsi).command("HELLO", 3)
    assert (number, code, joints) == ("3", 0, HOME)
    assert re.search(rf'<Ident Serial="SIM-\d+" Model="KUKA KR5 R1400" KSS="[^"]+"{rsi_on} Version="1"/><Q A1=', text)


def test_a_move_ends_at_its_target_and_says_so(bench):
    pc = bench()
    assert pc.ptp(THERE)[:3] == ("1", 0, THERE)
    assert pc.command("HELLO")[2] == THERE


def test_a_move_takes_the_time_that_speed_and_distance_say(bench):
    pc = bench()
    begin = pc.kernel.now
    pc.command("PTP", 1, body((77.0, *HOME[1:]), "50.0"))
    # 77° at 77 deg/s, and half a cosine of acceleration to 77 deg/s whose peak is 154/0.4 deg/s²
    least = (1.0 + 3.14159 / 2 * 77.0 / 385.0) * 1e9
    assert least <= pc.kernel.now - begin


def test_a_state_greets_and_comes_every_100_ms_and_at_each_change(bench):
    pc = bench()
    pc.put(f'<Cmd Id="1" Op="PTP">{body()}</Cmd>')
    seen = [pc.document("Stat")]
    while not ('Prog="READY"' in seen[-1] and 'A1="10.0000"' in seen[-1]):
        seen.append(pc.document("Stat"))
    sequence = [int(re.search(r'Seq="(\d+)"', text)[1]) for text in seen]
    assert sequence == list(range(1, len(seen) + 1))
    assert all('Mode="EXT"' in text and 'Msg=""' in text for text in seen)
    assert 'Prog="READY"' in seen[0]
    moving = [text for text in seen if 'Prog="MOVING"' in text]
    assert len(moving) == pytest.approx(1 + 10 * (10.0 / 15.4 + 0.4 * 0.1), abs=4)


def test_documents_may_come_split_and_joined_in_any_way(bench):
    pc = bench()
    text = b' <Cmd Id="1" Op="HELLO"/>\n<Cmd Id="2" Op="HELLO"></Cmd><Cmd Id="3" Op="HELLO"/>'
    pc.tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for piece in (text[:9], text[9:40], text[40:41], text[41:]):
        pc.tcp.sendall(piece)
    assert [pc.reply()[:2] for _ in range(3)] == [("1", 0), ("2", 0), ("3", 0)]


@pytest.mark.parametrize(
    ("document", "number"),
    [
        ('<Cmd Id="4" Op="DANCE"/>', "4"),
        ('<Cmd Id="4" Op="PTP"><Vel P="10.0"/></Cmd>', "4"),
        ('<Cmd Id="4" Op="PTP"><Vel P="fast"/><Q A1="0" A2="0" A3="0" A4="0" A5="0" A6="0"/></Cmd>', "4"),
        ('<Cmd Id="4" Op="PTP"><Vel P="10"/><Q A1="nan" A2="0" A3="0" A4="0" A5="0" A6="0"/></Cmd>', "4"),
        ('<Cmd Id="4" Op="PTP"><Vel P="1_0"/><Q A1="0" A2="0" A3="0" A4="0" A5="0" A6="0"/></Cmd>', "4"),
        ('<Cmd Id="4" Op="PTP"><Vel P="١٠"/><Q A1="0" A2="0" A3="0" A4="0" A5="0" A6="0"/></Cmd>', "4"),
        ('<Cmd Id="4" Op="PTP"><Vel P="10"/><Q A1="0" A2="0" A3="0" A4="0" A5="0" A6="3601"/></Cmd>', "4"),
        ('<!DOCTYPE Cmd><Cmd Id="4" Op="HELLO"/>', ""),
        ("<a>" * 1000 + "</a>" * 1000, ""),
        ('<Sen Id="4" Op="HALT"/>', "4"),
        ('<Cmd Id="4" Op="HALT" Op="HALT"/>', ""),
        ("<Cmd></Bmd>", ""),
        ("hello there<", ""),
    ],
)
def test_what_cannot_be_read_is_answered_11_and_the_channel_goes_on(bench, document, number):
    pc = bench()
    pc.put(document)
    if document.endswith("<"):
        pc.put("Cmd Id='5' Op='HELLO'/>")
    assert pc.reply()[:2] == (number, 11)
    if not document.endswith("<"):
        pc.put("<Cmd Id='5' Op='HELLO'/>")
    assert pc.reply()[:2] == ("5", 0)


@pytest.mark.parametrize("percent", ["0", "-5.0", "100.1", "1e-300", "0.0099", "1e5"])
def test_a_speed_outside_its_range_is_refused(bench, percent):
    pc = bench()
    assert pc.command("PTP", 1, body(THERE, percent))[1:3] == (21, HOME)
    assert pc.command("PTP", 2, body(HOME, "0.01"))[1] == 0


def test_a_target_outside_an_axis_limit_is_refused_and_nothing_moves(bench):
    _, code, joints, text = bench().ptp((0.0, 66.0, 90.0, 0.0, 45.0, 0.0))
    assert (code, joints) == (20, HOME)
    assert "A2" in text


def test_a_second_command_finds_the_controller_busy_and_changes_nothing(bench):
    pc = bench()
    pc.put(f'<Cmd Id="1" Op="PTP">{body(FAR, "5.0")}</Cmd><Cmd Id="2" Op="PTP">{body()}</Cmd><Cmd Id="3" Op="RESET"/>')
    assert pc.reply()[:2] == ("2", 10)
    assert pc.reply()[:2] == ("3", 10)
    number, code, joints, _ = pc.reply()
    assert (number, code, joints) == ("1", 0, FAR)


def test_halt_stops_a_move_on_its_way_and_the_next_command_goes(bench):
    pc = bench()
    pc.put(f'<Cmd Id="1" Op="PTP">{body(FAR, "0.1")}</Cmd>')
    while 'A1="0.0000"' in pc.state(['Prog="MOVING"']):
        pass
    pc.put('<Cmd Id="2" Op="HALT"/>')
    stopped, halted = pc.reply(), pc.reply()
    assert (stopped[:2], halted[:2]) == (("1", 30), ("2", 0))
    assert stopped[2] == halted[2]
    assert HOME != halted[2] != FAR
    on_line = [(q - a) / (b - a) for q, a, b in zip(halted[2], HOME, FAR, strict=True)]
    assert on_line == pytest.approx([on_line[0]] * 6, abs=1e-4)
    pc.state(['Prog="STOPPED"'])
    assert pc.ptp(HOME)[1:3] == (0, HOME)


def test_halt_of_a_standing_robot_is_done_at_once(bench):
    assert bench().command("HALT", 9)[:2] == ("9", 0)


def test_the_operators_stop_brakes_shows_a_message_and_needs_a_reset(bench):
    pc = bench()
    pc.put(f'<Cmd Id="1" Op="PTP">{body(FAR, "0.1")}</Cmd>')
    pc.state(['Prog="MOVING"'])
    pc.fault(fault="robot.stop")
    number, code, joints, text = pc.reply()
    assert (number, code) == ("1", 31)
    assert 'Text="KSS' in text
    assert joints != FAR
    pc.state(['Prog="ERROR"', 'Msg="KSS'])
    assert pc.ptp(HOME)[1:3] == (12, joints)
    assert pc.command("RSI")[1] == 12
    assert pc.command("RESET")[1] == 0
    assert pc.ptp(HOME)[1:3] == (0, HOME)


def test_a_lost_connection_stops_the_robot_and_the_next_one_finds_it_held(bench):
    pc = bench()
    pc.put(f'<Cmd Id="1" Op="PTP">{body(FAR, "0.1")}</Cmd>')
    pc.state(['Prog="MOVING"'])
    pc.tcp.close()
    pc.connect()
    stopped = pc.state(['Prog="STOPPED"'])
    held = pc.command("HELLO", 8)
    assert held[0] == "8"  # no late answer to the command of the lost connection
    assert held[2] != FAR
    assert f'A1="{held[2][0]:.4f}"' in stopped
    assert pc.ptp(HOME)[1] == 0


def test_a_pc_that_did_not_read_for_a_while_gets_every_reply_in_order(bench):
    pc = bench()
    count = 1200  # replies of 200 bytes: more than TCP keeps for it
    for number in range(count):
        pc.put(f'<Cmd Id="{number}" Op="HELLO"/>')
    pc.let_pass(0.5)
    assert [pc.reply()[0] for _ in range(count)] == [str(number) for number in range(count)]
    assert pc.ptp(THERE)[1] == 0


def test_a_document_of_5_mb_is_refused_and_hung_up_on_and_the_next_pc_is_served(bench):
    pc = bench()
    with pytest.raises(ConnectionError):
        pc.tcp.sendall(b"<Cmd>" + b"x" * 5_000_000)
    pc.tcp.close()
    pc.connect()
    assert pc.command("HELLO", 3)[:2] == ("3", 0)


def test_only_one_pc_is_served_at_a_time(bench):
    pc = bench()
    pc.command("HELLO")
    with socket.create_connection(("127.0.0.1", pc.krc.eki_port), 10) as second:
        assert second.recv(100) == b""
    assert pc.command("HELLO")[1] == 0


def test_a_transfer_through_a_sphere_ends_in_a_collision_message(bench):
    pc = bench()
    sphere = pc.world().spheres[2]
    inside = pose_towards(pc.world(), sphere.centre)
    _, code, _, text = pc.ptp(inside, 10.0)
    assert code == 31
    assert "KSS00117" in text
    assert "ollision" in text
    assert pc.changes[0][1] is True
    assert pc.command("RESET")[1] == 0
    assert pc.ptp(HOME, 10.0)[1] == 0
    assert pc.changes[-1][1] is False


def pose_towards(world, point):
    """Joints near HOME whose tool is at a point: Newton's method on the world itself, position only."""
    import numpy as np

    q = np.array(HOME)
    for _ in range(50):
        p = np.array(world.true_tcp(q))
        J = np.array([(np.array(world.true_tcp(q + step)) - p) / 1e-4 for step in np.eye(6) * 1e-4]).T
        q = q + np.linalg.pinv(J) @ (np.array(point) - p)
    return tuple(round(float(angle), 4) for angle in q)
