"""Programs of the controller's user: given over the control port, run by `OWN`."""

from __future__ import annotations

import pytest

from sims.simulator import Refused

HOME = [0.0, -90.0, 90.0, 0.0, 45.0, 0.0]
BESIDE = [0.1, -90.0, 90.0, 0.0, 45.0, 0.0]
GOOD = {"number": 1, "every_ms": 12, "joints": [HOME, HOME, BESIDE, BESIDE]}


def run(pc, number):
    pc.put(f'<Cmd Id="4" Op="OWN"><Row N="{number}"/></Cmd>')
    return pc.reply()


def test_a_program_ends_where_its_last_step_is(bench):
    pc = bench()
    pc.krc.take_program(GOOD)
    _, code, joints, _ = run(pc, 1)
    assert (code, list(joints)) == (0, BESIDE)


def test_a_program_that_does_not_begin_here_is_refused(bench):
    pc = bench()
    for begin, code in ((0.0101, 12), (0.0099, 0)):
        pc.krc.take_program({**GOOD, "joints": [[begin, *HOME[1:]]] * 2})
        assert run(pc, 1)[1] == code
    assert run(pc, 2)[1] == 42


@pytest.mark.parametrize(
    "wrong",
    [
        {"number": 0},
        {"every_ms": 1001},
        {"joints": [HOME]},
        {"joints": [HOME] * 20_001},
        {"joints": [HOME, HOME[:5]]},
        {"joints": [HOME, [float("nan")] * 6]},
    ],
)
def test_a_program_that_cannot_be_run_is_refused(bench, wrong):
    with pytest.raises(Refused):
        bench().krc.take_program({**GOOD, **wrong})
