"""A set-up error that a campaign finds in its touches ends the run as it ends a fit: before a model, before a table."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.cli.exit_codes import Exit
from cellctl.cli.run_progress import exit_of, show_end
from cellctl.engine import State
from cellctl.operations.launch import result_of
from tests.helpers.runs import UNHURRIED, quick_cell, run_here, touches_procedure

IDENTIFY = """  - {id: identify, do: sphere.identify, with: {model: geometry}, timeout: 300}
cleanup:"""


@pytest.mark.long
@pytest.mark.campaign
def test_a_wrong_certified_distance_ends_the_run_with_exit_code_2_its_line_and_no_model(tmp_path: Path, capsys) -> None:
    procedure = touches_procedure(tmp_path, fit=30)  # fewer do not check each other
    text = procedure.read_text().replace("held_out: 1", "held_out: 5").replace("cleanup:", IDENTIFY)
    procedure.write_text(text)
    for name in ("true", "stated"):
        (tmp_path / name).mkdir()
    truth = quick_cell(tmp_path / "true", UNHURRIED)
    stated = quick_cell(tmp_path / "stated", UNHURRIED, {"mm: 700.412": "mm: 705.412"})
    ended = run_here(procedure, stated, tmp_path, simulated_cell=truth)
    run = tmp_path / "run"
    assert (ended.outcome.state, exit_of(ended.outcome)) == (State.FAILED, Exit.BAD_INPUT)
    assert ended.robot_is_held()
    assert not (run / "model.json").exists()
    show_end(ended.outcome, result_of(run, ended.outcome, 1.0), run, quiet=False)
    said = capsys.readouterr().err
    assert "run failed: 1 error\n" in said
    assert f"{stated}:24:31: spacing S1–S2: 705.412 mm given" in said
    assert "no model was made and no table was pushed" in said
    assert "nothing was moved" not in said
