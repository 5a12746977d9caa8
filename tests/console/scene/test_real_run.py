"""The scene of a campaign that ran: its journal, cut at every part of the run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellctl.console.scene import scene_of, series_of
from cellctl.journal import fold, read_journal
from tests.helpers.runs import CELL, run_here, touches_procedure

pytestmark = [pytest.mark.campaign, pytest.mark.long]


def test_at_every_event_each_planned_touch_is_either_measured_or_to_come(tmp_path: Path) -> None:
    ended = run_here(touches_procedure(tmp_path), CELL, tmp_path)
    entries = list(read_journal(tmp_path / "run"))
    for cut in range(1, len(entries) + 1):
        state = fold(entries[:cut])
        content = scene_of(state)
        seq = np.concatenate([group.seq for group in content.points]) if content.points else np.zeros(0)
        assert content.problems == ()
        assert len(seq) == (6 if "plan" in state.finished else 0)
        assert int((seq > 0).sum()) == len(state.data_of("touch")) == series_of(state, content.points).measured
    measured = {label: at for group in content.points for label, at in zip(group.label, group.at, strict=True)}
    truth = [contact["tcp"] for contact in ended.truth]
    off = [np.linalg.norm(measured[str(number)] - place) for number, place in enumerate(truth)]
    assert max(off) < 10.0  # the nominal robot is some mm off the true one
