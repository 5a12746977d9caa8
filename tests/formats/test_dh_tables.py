"""DH tables as people write them: read by column name, every wrong cell named by its line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.formats.dh_table import load_dh_table
from tests.helpers.own_model import assert_same_pose, forward_of_dh_table

TABLE = """\
joint,convention,alpha,a,d,theta,beta,sign,offset,X,Y,Z,A,B,C
base,dh-craig,,,,,,,,100,0,50,90,0,0
1,dh-craig,0,0,400,0,,-1,10,,,,,,
2,dh-craig,-90,180,0,-90,,1,0,,,,,,
3,dh-craig,0.2,600,35,0,0.1,1,,,,,,,
tool,dh-craig,,,,,,,,0,0,120,0,180,30
"""
BARE = "theta,d,a,alpha\n0,127.3,0,90\n0,0,-612,0\n0,0,-572.3,0\n"


def load(tmp_path, text, convention=None):
    (tmp_path / "table.csv").write_text(text)
    return load_dh_table(tmp_path / "table.csv", convention)


def errors(tmp_path, text, convention=None):
    with pytest.raises(InputError) as caught:
        load(tmp_path, text, convention)
    return [(problem.line, f"{problem.what} {problem.cure}") for problem in caught.value.problems]


def test_a_table_as_a_german_spreadsheet_saves_it_is_the_same_table(tmp_path):
    as_saved = BARE.replace(",", ";").replace(".", ",")
    assert load(tmp_path, as_saved, "dh-craig").joints == load(tmp_path, BARE, "dh-craig").joints
    np.testing.assert_array_equal(
        load(tmp_path, as_saved, "dh-craig").chain.forward(np.ones(3)),
        load(tmp_path, BARE, "dh-craig").chain.forward(np.ones(3)),
    )


def test_a_full_table_puts_the_tool_where_its_rows_say(tmp_path):
    robot = load(tmp_path, TABLE)
    for readings in np.random.default_rng(0).uniform(-90, 90, (4, 3)):
        found = robot.chain.forward(robot.joint_map().model(readings))
        assert_same_pose(found, forward_of_dh_table(TABLE, readings))


def test_a_bare_table_needs_its_convention_and_gets_beta_where_axes_are_parallel(tmp_path):
    assert "--table" in errors(tmp_path, BARE)[0][1]
    chain = load(tmp_path, BARE, "mdh-hayati").chain
    assert [name for name in chain.parameters if name.startswith(("d", "beta"))] == ["d1", "beta2", "d3"]
    np.testing.assert_allclose(chain.forward(np.zeros(3))[:3, 3], [-1184.3, 0, 127.3], atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("-90,180", "-1.5708,180", 4, "radians"),
        ("-90,180", "-90,wide", 4, "a 'wide' is not a number"),
        ("-90,180", "-90,", 4, "a is missing"),
        ("-90,180", "-90,1e300", 4, "not a number from -20000"),
        ("-90,180", "-900,180", 4, "not a number from -360"),
        ("0,0,400,0,,-1", "0,0,400,0,,-2", 3, "neither 1 nor -1"),
        ("\n2,", "\n3,", 4, "joint is '3', not 2"),
        ("0.2,600,35", "0.2,inf,35", 5, "not a number"),
        ("tool,dh-craig,", "base,dh-craig,", 6, "second row 'base'"),
        ("2,dh-craig", "2,mdh-hayati", 1, "dh-craig, mdh-hayati"),
        ("2,dh-craig,-90,", "2,dh-craig,", 4, "cells"),
        ("theta", "thta", 1, "no column theta"),
    ],
)
def test_a_wrong_cell_is_named_by_its_line(tmp_path, old, new, line, words):
    assert old in TABLE
    found = errors(tmp_path, TABLE.replace(old, new, 1))
    assert found[0][0] == line
    assert words in found[0][1]


@given(st.data())
def test_a_damaged_table_is_read_or_refused_and_nothing_else(tmp_path_factory, data):
    text = damaged(TABLE, data)
    try:
        chain = load(tmp_path_factory.getbasetemp(), text).chain
    except InputError:
        return
    assert np.isfinite(chain.forward(np.zeros(chain.n))).all()


def damaged(text, data):
    """With a piece of it taken out, doubled, or written over."""
    start = data.draw(st.integers(0, len(text) - 1))
    end = data.draw(st.integers(start, min(len(text), start + 30)))
    new = data.draw(st.sampled_from(["", text[start:end] * 2, "nan", "-", "1e999", '"', ",", "\n", "\0", "é"]))
    return text[:start] + new + text[end:]


def test_a_convention_asked_for_must_be_the_tables(tmp_path):
    assert "dh-craig" in errors(tmp_path, TABLE, "mdh-hayati")[0][1]
    assert load(tmp_path, TABLE, "dh-craig").chain.convention == "dh-craig"


def test_a_table_of_frames_alone_holds_no_joint(tmp_path):
    only_base = "\n".join(TABLE.splitlines()[:2]) + "\n"
    assert "no joint" in errors(tmp_path, only_base)[0][1]
