"""An interlock on the simulated cell: a wire that breaks between two searches stops the robot and not the campaign."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.engine import State
from cellctl.journal import InterlockChanged, StepEnded, read_journal
from tests.helpers.runs import UNHURRIED, cell_with, faults, run_here, touches_procedure

pytestmark = pytest.mark.campaign

INTERLOCKS = """interlocks:
  - {id: wire, device: probe, condition: whole, resume: auto}
  - {id: drives, device: robot, condition: ready, on_break: abort}
steps:
"""


@pytest.mark.long
def test_a_wire_that_breaks_in_a_transfer_stops_the_robot_and_the_touch_is_done_again(tmp_path: Path) -> None:
    procedure = touches_procedure(tmp_path, fit=5)
    procedure.write_text(procedure.read_text().replace("steps:\n", INTERLOCKS, 1))
    broken = faults("fault: probe.wire_break, search: 2, after_ms: 4500, for_ms: 1500")
    ended = run_here(procedure, cell_with(tmp_path, UNHURRIED + broken), tmp_path)
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    assert len(ended.touches) == 6
    assert ended.robot_is_held()
    events = [entry.event for entry in read_journal(tmp_path / "run")]
    changes = [event for event in events if isinstance(event, InterlockChanged)]
    assert [(event.interlock, event.holds) for event in changes] == [("wire", False), ("wire", True)]
    assert [event.outcome for event in events if isinstance(event, StepEnded)].count("cancelled") == 1
