"""The safety chain at the controller: the arm stops at once, and the message stays until its cause is gone."""

from __future__ import annotations

import pytest

FAR = (60.0, -90.0, 90.0, 0.0, 45.0, 0.0)
EMERGENCY, GUARD = "KSS00001 EMERGENCY STOP", "KSS00207 Operator safety / safety fence open"
ENABLE = "KSS00203 General motion enable"
CHAIN = pytest.mark.parametrize(
    ("fault", "message"), [("safety.emergency_stop", EMERGENCY), ("safety.guard_open", GUARD)]
)


@CHAIN
def test_a_move_is_braked_at_once_and_ends_with_the_message(bench, fault, message):
    krc = bench(faults=[{"fault": fault, "event": "robot.move", "count": 1, "after_ms": 300}])
    _, code, joints, text = krc.ptp(FAR, 20.0)
    assert code == 31
    assert message in text
    assert 0.0 < joints[0] < 20.0
    assert 'Prog="ERROR"' in krc.state([message])


@CHAIN
def test_a_search_is_ended_with_the_message_and_rsi_is_off(bench, fault, message):
    krc = bench(faults=[{"fault": fault, "search": 1, "after_ms": 200}])
    krc.rsi_on()
    _, code, _, text = krc.until_reply()
    assert code == 31
    assert message in text
    assert krc.scene.arm.state().velocity == (0.0,) * 6


@CHAIN
def test_at_rest_the_message_is_shown_and_nothing_moves_until_it_is_acknowledged(bench, fault, message):
    krc = bench()
    krc.fault(fault=fault)
    krc.state([message, 'Prog="ERROR"'])
    assert krc.ptp(FAR)[1] == 12
    assert krc.command("RESET")[1] == 12  # the chain is still open
    krc.kernel.at(krc.kernel.now, krc.scene.safety.close_guard)
    krc.kernel.at(krc.kernel.now, krc.scene.safety.close_emergency_stop)
    krc.let_pass(0.01)
    assert krc.ptp(FAR)[1] == 12  # closed, and not acknowledged
    assert krc.command("RESET")[1] == 0
    assert krc.ptp(FAR)[1] == 0


def test_without_the_plcs_enable_a_move_is_stopped_and_none_begins(bench):
    krc = bench()
    krc.put('<Cmd Id="5" Op="PTP"><Vel P="1"/><Q A1="60" A2="-90" A3="90" A4="0" A5="45" A6="0"/></Cmd>')
    krc.state(['Prog="MOVING"'])
    krc.kernel.at(krc.kernel.now, lambda: krc.scene.safety.enable_motion(False))
    _, code, _, text = krc.reply()
    assert code == 31
    assert ENABLE in text
    assert krc.command("RESET")[1] == 0
    assert krc.ptp(FAR)[1] == 12
    krc.kernel.at(krc.kernel.now, lambda: krc.scene.safety.enable_motion(True))
    krc.let_pass(0.01)
    assert krc.ptp(FAR)[1] == 0
