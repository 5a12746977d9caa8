"""One time left for a whole run: from what its steps expect, and from the pace of what was done."""

import io
from types import SimpleNamespace
from typing import Any

from rich.console import Console

from cellctl.cli.run_progress import RunDisplay
from cellctl.engine import Passes
from cellctl.operations.campaign import load_campaign
from cellctl.procedure import phase_titles
from tests.helpers.runs import SELFCAL


def test_the_time_left_is_that_of_the_whole_run_and_not_of_the_loop():
    now = [0.0]
    passes = Passes(100, lambda: now[0])
    passes.loop("points", 0, 40)
    passes.step_begins()
    now[0] = 30.0
    passes.loop("points", 10, 40)
    assert (passes.done, passes.total, passes.left_s) == (10, 100, 270.0)


def test_a_loop_in_a_loop_counts_once_and_an_unexpected_pass_adds_to_all():
    passes = Passes(3)
    for index in range(2):
        passes.loop("rounds", index, 2)
        for inner in range(3):
            passes.loop(f"rounds[{index}].standoffs", inner, 2)
    passes.loop("rounds", 2, 2)
    assert (passes.done, passes.total) == (4, 4)


def test_passes_that_a_resumed_run_skips_do_not_make_the_others_look_short():
    now = [0.0]
    passes = Passes(20, lambda: now[0])
    passes.loop("points", 10, 20)
    passes.step_begins()
    now[0] = 16.0
    passes.loop("points", 14, 20)
    assert passes.left_s == 24.0


def test_the_time_left_is_by_what_passes_of_each_loop_take_and_a_pause_does_not_stretch_it():
    now = [0.0]
    passes = Passes(25, lambda: now[0])
    passes.loop("touches", 0, 20)
    passes.step_begins()
    for done in range(1, 21):
        now[0] += 6.0 if done != 10 else 1806.0
        passes.loop("touches", done, 20)
    assert 5 * 6.0 <= passes.left_s <= 5 * 8.0
    passes.loop("rounds", 0, 5)
    now[0] += 60.0
    passes.loop("rounds", 1, 5)
    assert passes.left_s == 4 * 60.0


def test_the_shipped_campaign_says_how_much_there_is_to_do_in_readable_phases():
    campaign = load_campaign(SELFCAL, None, [], resumed=True)
    assert campaign.expected_passes == 80 + 4 + 8 + 60 + 3
    titles = phase_titles(campaign.procedure, campaign.registry)
    assert titles["touch"] == "Touch the spheres"
    assert titles["locate"] == "Locate the proof sphere"
    assert titles["identify"] == "identifying the robot"


def test_a_second_loop_over_the_same_list_is_shown_as_the_first_was(tmp_path):
    told = io.StringIO()
    bar: Any = SimpleNamespace(add_task=lambda *_, **__: 0, update=lambda *_, **__: None, disable=True)
    shown = RunDisplay(Console(file=told), bar, {}, Passes(20))
    for path in ("there", "back"):
        for index in range(21):
            shown.loop(path, index, 20)
    lines = [line.split(":")[1].strip() for line in told.getvalue().splitlines()]
    assert (lines[9], lines[-1]) == ("20 of 20", "40 of 40")
    assert len(lines) >= 14
