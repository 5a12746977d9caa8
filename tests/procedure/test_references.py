"""A reference is a whole value and leads to one place, or says that it leads nowhere."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.procedure import Reference, UnresolvedReference, resolve

names = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
ways = st.lists(names | st.integers(0, 99), max_size=4)


@given(names, ways)
def test_a_reference_reads_back_what_it_prints(name, way):
    reference = Reference(name, tuple(way))
    assert Reference.parse(str(reference)) == reference


@given(names, ways, st.integers())
def test_a_reference_leads_to_the_value_that_was_put_there(name, way, value):
    held = value
    for part in reversed(way):
        held = {part: held} if isinstance(part, str) else [None] * part + [held]
    assert resolve({"in": [Reference(name, tuple(way))]}, {name: held}) == {"in": [value]}


@pytest.mark.parametrize(
    "text", ["${}", "${A}", "${a.}", "${a[-1]}", "${a[x]}", "${a} ", "a", "$a", "${a+1}", "${a b}"]
)
def test_anything_else_is_no_reference(text):
    with pytest.raises(ValueError, match="no reference"):
        Reference.parse(text)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("${b}", "'b' is not known here"),
        ("${a.y}", "no field 'y'"),
        ("${a[0]}", "no element 0"),
        ("${a.x[2]}", "no element 2"),
        ("${a.x.y}", "no field 'y'"),
        ("${a.t[0]}", "no element 0"),
    ],
)
def test_a_reference_that_leads_nowhere_says_where_it_ends(text, why):
    with pytest.raises(UnresolvedReference, match=why):
        resolve(Reference.parse(text), {"a": {"x": [1, 2], "t": "text"}})
