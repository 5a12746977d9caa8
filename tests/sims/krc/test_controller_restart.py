"""The controller restarts: what it drops, what it holds on to, and when it can be called again."""

from __future__ import annotations

import select
import threading

import pytest

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
FAR = (150.0, 60.0, 160.0, 300.0, 100.0, 300.0)
PATIENCE_S = 60.0


def hung_up(pc):
    try:
        while pc.tcp.recv(65536):
            pass
    except ConnectionResetError:
        pass


def call_again(pc):
    """Call until it answers."""
    refused = 0
    while True:
        try:
            pc.connect()
            return
        except ConnectionRefusedError:
            refused += 1
            assert refused < PATIENCE_S * 100
            pc.tcp.close()
            threading.Event().wait(0.01)


def test_the_channel_drops_and_is_there_again_on_the_same_port_two_seconds_later(bench):
    pc = bench(mode="realtime")
    port = pc.krc.eki_port
    begun = pc.fault(fault="robot.restart")
    hung_up(pc)
    pc.tcp.close()
    call_again(pc)
    assert pc.kernel.now - begun >= 2e9, "who calls earlier is refused"
    assert pc.krc.eki_port == port
    pc.state(['Prog="STOPPED"', 'Msg=""'])
    assert pc.ptp(HOME)[1] == 0


def test_a_robot_on_its_way_is_braked_and_held(bench):
    pc = bench(mode="realtime")
    pc.put('<Cmd Id="1" Op="PTP"><Vel P="2.0"/><Q A1="90" A2="-90" A3="90" A4="0" A5="45" A6="0"/></Cmd>')
    while 'A1="0.' in pc.state(['Prog="MOVING"']):
        pass
    pc.fault(fault="robot.restart")
    hung_up(pc)
    pc.tcp.close()
    call_again(pc)
    held = pc.command("HELLO", 8)
    assert held[0] == "8"  # nobody answers the command of before
    assert 1.0 < held[2][0] < 20.0
    assert held[2][1:] == HOME[1:]
    assert pc.command("HELLO", 9)[2] == held[2]
    assert pc.ptp(HOME)[1] == 0


def test_the_active_table_stays_and_the_staged_one_is_lost(bench):
    pc = bench(mode="realtime")
    pc.push_row(HOME, "one")
    serial = pc.command("HELLO")[3].split('Serial="')[1].split('"')[0]
    assert pc.command("TSTAGE", 20, f'<Table Id="two" Serial="{serial}" Rows="1" Sum="00000000"/>')[1] == 0
    assert pc.tables() == {"Active": "one", "Staged": "two"}
    pc.fault(fault="robot.restart")
    hung_up(pc)
    pc.tcp.close()
    call_again(pc)
    assert pc.tables() == {"Active": "one"}


def test_sensor_telegrams_stop_at_once(bench):
    pc = bench(mode="realtime")
    pc.rsi_on()
    pc.cycles(20)
    pc.fault(fault="robot.restart")
    hung_up(pc)
    pc.udp.setblocking(False)
    while select.select([pc.udp], [], [], 0)[0]:
        pc.telegram()  # what was on its way
    assert not select.select([pc.udp], [], [], 0.2)[0]  # fifty cycles
    pc.tcp.close()
    call_again(pc)
    assert pc.command("HELLO", 8)[2] == pytest.approx(HOME, abs=1e-3)


def test_a_cell_in_lockstep_goes_on_after_a_restart_in_mid_search(bench):
    pc = bench(faults=[{"fault": "robot.restart", "search": 1, "after_ms": 18}])
    pc.rsi_on()
    pc.cycles(5)  # 0 … 16 ms
    hung_up(pc)
    pc.tcp.close()
    call_again(pc)
    pc.udp.setblocking(False)
    while select.select([pc.udp], [], [], 0.1)[0]:
        pc.telegram()
    pc.udp.settimeout(PATIENCE_S)
    pc.rsi_on(8)
    pc.cycles(10)
    assert pc.finish()[:2] == ("8", 0)


def test_a_standing_message_is_gone_after_a_restart(bench):
    pc = bench(mode="realtime", faults=[{"fault": "robot.stop"}])
    pc.state(['Prog="ERROR"'])
    pc.fault(fault="robot.restart")
    hung_up(pc)
    pc.tcp.close()
    call_again(pc)
    pc.state(['Prog="STOPPED"', 'Msg=""'])
    assert pc.ptp(HOME)[1] == 0
