"""The HTML views of a notebook: well formed, self-contained, with verdict, figures and picture."""

from html.parser import HTMLParser

import numpy as np

import cellctl


class Checked(HTMLParser):
    """Opened and not closed tags; ids; texts."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.texts, self.tags = [], [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.ids += [value for name, value in attributes if name == "id"]
        assert not [value for _, value in attributes if value and "://" in value and "w3.org" not in value]
        self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def checked(view):
    page = Checked()
    page.feed(view._repr_html_())
    assert page.open == []
    assert "script" not in page.tags
    return page


def test_a_model_shows_verdict_errors_and_picture(model, files):
    page = checked(model)
    assert model.sentence in page.texts
    assert "held-out positions, identified" in page.texts
    assert page.tags.count("svg") == 1
    checked(model.save("model.json"))
    loaded = checked(cellctl.load("model.json"))
    assert loaded.tags.count("svg") == 1


def test_several_views_on_one_page_share_no_id(model, columns):
    q = np.column_stack([columns[name] for name in ("A1", "A2", "A3")])
    found = model.predict(q)
    views = [
        model,
        model.compensate(found.poses[:5], postures=q[:5]),
        model.compensate(found.poses[5:9], postures=q[5:9]),
    ]
    ids = [each for view in views for each in checked(view).ids]
    assert len(ids) == len(set(ids)) > 0


def test_predictions_name_rows_outside_the_measured_region(model):
    page = checked(model.predict([[0.0, -30.0, -60.0], [170.0, 100.0, 100.0]]))
    assert page.texts.count("outside the measured region") == 1
    assert "2 postures predicted, 1 outside the measured region" in page.texts


def test_data_shows_the_range_of_each_column_with_its_unit(columns):
    page = checked(cellctl.read({**columns, "label": ["<b>"] * 60}))
    assert "data: 60 rows" in page.texts
    assert "<b>" in page.texts  # as text
    assert page.texts[page.texts.index("A1") + 1] == "deg"


def test_a_robot_shows_its_joints():
    assert "Universal Robots UR10" in checked(cellctl.robot("ur10")).texts


def test_short_texts_say_what_each_object_is(model, columns):
    assert repr(model) == "<cellctl model of elbow arm: geometry, better>"
    assert repr(cellctl.robot("ur10")) == "<cellctl robot Universal Robots UR10: 6 joints>"
    assert repr(cellctl.read(columns)) == "<cellctl data data: 60 rows, A1, A2, A3, X, Y, Z, set>"
