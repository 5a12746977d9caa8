"""The scene on a page: what goes to the browser when the run goes on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from nicegui import ui
from nicegui.client import Client

from cellctl.console.scene import SceneContent, scene_of
from cellctl.console.scene.run_points import Points, Role
from cellctl.console.scene.view import HEADINGS, PAGE, SceneView, body_rows, point_rows, scene_view
from tests.helpers.journals import touch_run


class Sent:
    """A page with a scene, and the calls that its browser gets."""

    def __init__(self, content: SceneContent, monkeypatch: pytest.MonkeyPatch) -> None:
        self.view: SceneView = scene_view(content)
        self.calls: list[tuple[Any, ...]] = []
        monkeypatch.setattr(self.view._scene, "run_method", lambda *call, **_: self.calls.append(call))

    def marks(self) -> list[tuple[int, list[int]]]:
        """Of each change of marks: how many there are, and the places that changed."""
        return [(call[3], list(call[4])) for call in self.calls if call[2:3] == ("set_marks",)]


@pytest.fixture
def on_a_page() -> Iterator[None]:
    client = Client(ui.page("/made"), request=None)
    with client:
        yield
    client.delete()


@pytest.mark.usefixtures("on_a_page")
def test_the_same_content_again_sends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    run = touch_run(20, 10)
    sent = Sent(scene_of(run.state()), monkeypatch)
    sent.view.update(scene_of(run.state()))
    assert sent.calls == []


@pytest.mark.usefixtures("on_a_page")
def test_a_new_touch_sends_the_robot_and_its_own_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    sent = Sent(scene_of(touch_run(9, 2).state()), monkeypatch)
    sent.view.update(scene_of(touch_run(9, 3).state()))
    assert {call[0] for call in sent.calls} == {"move", "rotate", "run_method_on_component"}
    assert len(sent.calls) <= 2 * 7 + 2
    assert sent.marks() == [(4, [0]), (3, [2])]


@pytest.mark.usefixtures("on_a_page")
def test_a_page_that_comes_back_gets_all_marks_again(monkeypatch: pytest.MonkeyPatch) -> None:
    sent = Sent(scene_of(touch_run(9, 2).state()), monkeypatch)
    sent.view.update(scene_of(touch_run(9, 5).state()))
    lengths = [thing.args[3] for thing in sent.view._scene.objects.values() if thing.args[:1] == ["disc"]]
    assert lengths == [9 - 2 - 4, 4]


@pytest.mark.usefixtures("on_a_page")
def test_one_more_point_beside_ten_thousand_sends_one_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    at = np.random.default_rng(1).uniform(0.0, 1000.0, (10_001, 3))
    contents = [
        SceneContent(points=(Points.of("touch", Role.FIT, range(n), at[:n], seq=1, after=0.1),))
        for n in (10_000, 10_001)
    ]
    sent = Sent(contents[0], monkeypatch)
    sent.view.update(contents[1])
    assert sent.marks() == [(10_001, [10_000])]
    assert len(sent.calls) == 1


def test_the_table_has_every_body_and_every_point() -> None:
    content = scene_of(touch_run(40, 10).state())
    rows = [*body_rows(content), *point_rows(content.points, 0, 1000)]
    assert [row[0] for row in rows if row[0].startswith("sphere")] == [
        f"sphere {name}, radius 30.70 mm" for name in ("S1", "S2", "S3", "P1")
    ]
    assert sum(row[2] == "measured" for row in rows) == 10
    assert sum(row[2] == "to come" for row in rows) == 30
    assert {len(row) for row in rows} == {len(HEADINGS)}


def test_the_pages_of_the_table_follow_each_other() -> None:
    points = scene_of(touch_run(60, 30).state()).points
    pages = [row for first in range(0, 75, PAGE) for row in point_rows(points, first, PAGE)]
    assert pages == point_rows(points, 0, 60)
