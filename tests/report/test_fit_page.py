"""The page of a fit: whole, self-contained, light, for every kind of rows and the odd cases."""

import re

import numpy as np
import pytest

from cellctl.calibration import Backlash, Harmonics, JointCompliance, Postures, Split, Task, ThermalExpansion
from cellctl.report.fit import FitStory
from cellctl.report.fit.page import fit_page, write_fit_page
from tests.helpers.reports import (
    Page,
    arm,
    measured,
    pointed,
    poses,
    positions,
    sessions,
    sockets,
    told,
    touches,
    truth,
)

HEADINGS = [
    "Set-up",
    "Before and after",
    "Residual against each joint",
    "Residual by place",
    "Residual by order",
    "As large as predicted?",
    "Identified parameters",
    "Correlation",
    "Unobservable parameters",
    "Predicted σ over the joints",
    "What to measure next",
    "Rows left out",
    "What each σ means",
]
TASKS = {
    "position": lambda: measured(positions(60)),
    "pose": lambda: measured(poses(40)),
    "touches": lambda: pointed(touches(60)),
    "sockets": lambda: pointed(sockets(45)),
    "mixture": lambda: sessions(40),
}


@pytest.fixture(scope="module", params=TASKS)
def story(request):
    return told(TASKS[request.param]())


def checked(text: str) -> Page:
    page = Page(text)
    assert page.fetched == []
    assert "script" not in page.tags
    assert len(page.ids) == len(set(page.ids))
    assert not re.search(r"\bnan\b|\binf\b|None(?!\.)|Undefined", page.text)
    return page


def headings(text: str) -> list[str]:
    return re.findall(r"<h2>(.*?)</h2>", text)


@pytest.mark.long
def test_every_kind_of_rows_has_the_whole_page_and_nothing_is_fetched(story):
    text = fit_page(story)
    checked(text)
    assert headings(text) == HEADINGS
    assert len(text) < 1_500_000


@pytest.mark.long
def test_the_same_fit_gives_the_same_bytes():
    story = told(measured(positions(40)))
    assert fit_page(story) == fit_page(story)


@pytest.mark.parametrize("joints", [1, 6, pytest.param(8, marks=pytest.mark.long)])
def test_robots_of_one_to_eight_joints_have_their_page(joints):
    robot = arm(joints)
    region = np.array([[-80.0] * joints, [80.0] * joints])
    story = told(measured(positions(60, robot=robot, region=region), robot), robot=robot)
    page = checked(fit_page(story))
    assert f"A{joints}" in page.text
    assert f"A{joints + 1}," not in page.text


@pytest.mark.long
def test_three_thousand_rows_stay_light_and_say_that_not_all_are_drawn():
    text = fit_page(told(measured(positions(3000))))
    assert len(text) < 3_000_000
    assert "Rows are gathered in cells" in checked(text).text


@pytest.mark.long
def test_without_held_out_rows_it_says_that_nothing_is_proved():
    page = checked(fit_page(told(measured(positions(30)), held_out=0)))
    assert "No row was held out: nothing on this page is proved" in page.text


@pytest.mark.long
def test_with_folds_it_says_whose_residuals_are_drawn():
    page = checked(fit_page(told(measured(positions(40)), split=Split.folds(40, 4, 0))))
    assert "Each of 4 parts" in page.text


@pytest.mark.long
def test_rows_that_were_not_used_are_there_by_line_and_their_text_is_text():
    story = told(measured(positions(40)), rejected=[{"line": 77, "reason": "A1 is <b>x</b>"}])
    text = fit_page(story)
    assert "A1 is &lt;b&gt;x&lt;/b&gt;" in text
    assert "77 not usable" in checked(text).text


@pytest.mark.long
def test_an_outlier_is_named_and_does_not_set_the_scale_of_the_pictures():
    rows = positions(60)
    rows.xyz[7] += 25.0
    text = fit_page(told(measured(rows), held_out=0))
    assert "9 left out" in checked(text).text
    ticks = re.findall(r">([−\d.]+)</text>", text[text.index("Residual by order") : text.index("As large as")])
    assert max(abs(float(tick.replace("−", "-"))) for tick in ticks if "." in tick) < 1.0


@pytest.mark.long
def test_effects_have_symbols_and_units_of_their_own():
    at = positions(150).postures
    rng = np.random.default_rng(1)
    rows = positions(150)
    conditions = Postures(
        at.q, rng.choice([-1.0, 1.0], at.q.shape), rng.uniform(0.0, 10.0, 150), rng.choice([0.0, 5.0], 150)
    )
    rows = type(rows)(conditions, rows.xyz, rows.sigma)
    task = measured(rows)
    chain = task.model.chain
    effects = (JointCompliance.of(chain, True), Harmonics(6), Backlash(6), ThermalExpansion.of(chain))
    page = checked(fit_page(told(task.with_effects(effects))))
    for words in ("A2 sag by link 3, x", "A2 sag by payload", "µrad/(N·m)", "A4 half play", "µm/(m·K)"):
        assert words in page.text
    assert "Not listed: 576 coefficients of harmonics" in page.text
    assert "A3 sin" not in page.text.partition("Identified parameters")[2].partition("Unobservable parameters")[0]
    assert "Coming: the sense in which each joint last turns" in page.text


@pytest.mark.long
def test_two_sessions_are_told_apart_and_placed():
    page = checked(fit_page(told(sessions(40))))
    assert "sessions cell, tracker" in page.text
    assert "base tracker" in page.text
    assert "the robot's base frame" in page.text
    assert "could be measured in tracker" in page.text


@pytest.mark.long
def test_a_socket_or_a_session_that_the_fit_never_saw_has_its_errors_on_the_page():
    rows = sockets(45)
    page = checked(fit_page(told(pointed(rows), split=Split.by_column(rows.point == 2))))
    assert "not visited in the fit" in page.text
    checked(fit_page(told(sessions(40), split=Split.by_column(np.arange(80) >= 40))))


@pytest.mark.long
def test_partial_work_is_told_against_the_older_model():
    older, task = truth(), measured(positions(20))
    prior = np.diag(np.full(len(older.parameters), 1e-6))
    partial = Task(older, task.rows, prior=prior, groups=frozenset({"zeros", "base"}))
    page = checked(fit_page(told(partial)))
    assert "before (prior model)" in page.text
    assert "Joint zeros (6)" in page.text
    assert "Links (" not in page.text


@pytest.mark.long
def test_hardly_any_rows_have_a_page():
    checked(fit_page(told(measured(positions(5)), held_out=0)))


@pytest.mark.long
def test_it_is_written_where_it_is_asked_for(tmp_path):
    story: FitStory = told(measured(positions(30)))
    write_fit_page(tmp_path / "fit.html", story)
    assert (tmp_path / "fit.html").read_text(encoding="utf-8") == fit_page(story)
