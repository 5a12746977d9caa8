"""The drive's side of the CiA 402 state machine, against the masks and controlwords of the standard."""

import pytest

from sims.drives._drive import StateMachine

MASKS = {
    "switch on disabled": (0x4F, 0x40),
    "ready to switch on": (0x6F, 0x21),
    "switched on": (0x6F, 0x23),
    "operation enabled": (0x6F, 0x27),
    "quick stop active": (0x6F, 0x07),
    "fault": (0x4F, 0x08),
}


def shown(machine):
    (name,) = [name for name, (mask, bits) in MASKS.items() if machine.statusword & mask == bits]
    return name


def after(*words):
    machine = StateMachine()
    for word in words:
        machine.control(word)
    return shown(machine)


@pytest.mark.parametrize(
    ("words", "state"),
    [
        ((), "switch on disabled"),
        ((0x07,), "switch on disabled"),
        ((0x06,), "ready to switch on"),
        ((0x06, 0x07), "switched on"),
        ((0x06, 0x0F), "operation enabled"),
        ((0x06, 0x07, 0x0F), "operation enabled"),
        ((0x06, 0x07, 0x0F, 0x07), "switched on"),
        ((0x06, 0x07, 0x0F, 0x06), "ready to switch on"),
        ((0x06, 0x07, 0x0F, 0x00), "switch on disabled"),
        ((0x06, 0x07, 0x0F, 0x02), "quick stop active"),
        ((0x06, 0x07, 0x0F, 0x02, 0x0F), "operation enabled"),
        ((0x06, 0x07, 0x0F, 0x02, 0x00), "switch on disabled"),
        ((0x06, 0x07, 0x02), "switch on disabled"),
    ],
)
def test_a_controlword_leads_to_the_state_of_the_standard(words, state):
    assert after(*words) == state


def test_a_fault_ends_only_with_a_rising_edge_of_its_reset_bit():
    machine = StateMachine()
    machine.control(0x86)
    machine.fail()
    machine.control(0x86)  # bit 7 has been set all along
    assert shown(machine) == "fault"
    machine.control(0x0F)
    assert shown(machine) == "fault"
    machine.control(0x80)
    assert shown(machine) == "switch on disabled"


def test_the_statusword_shows_voltage_only_with_power_on():
    machine = StateMachine()
    assert not machine.statusword & 0x10
    machine.control(0x06)
    assert machine.statusword & 0x10
    machine.fail()
    assert not machine.statusword & 0x10
