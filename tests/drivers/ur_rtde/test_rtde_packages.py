"""RTDE's packages: cut anywhere, made and read again, and any bytes in their place."""

from __future__ import annotations

import struct
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.ur_rtde.codec import Kind, PackageStream, Recipe, packed, recipe_of, text_of
from drivers.ur_rtde.kinematics_info import kinematics_of

RECIPE = Recipe(3, ("count", "joints", "on", "bits"), ("INT32", "VECTOR6D", "BOOL", "UINT64"))
DOUBLES = st.floats(allow_nan=False)


@given(st.lists(st.binary(max_size=40), max_size=6), st.data())
def test_packages_are_whole_wherever_the_stream_is_cut(contents, data):
    stream, whole = PackageStream(), b"".join(packed(Kind.TEXT, content) for content in contents)
    found = []
    while whole:
        cut = data.draw(st.integers(1, len(whole)))
        found += stream.feed(whole[:cut])
        whole = whole[cut:]
    assert [package.payload for package in found] == contents


@given(st.integers(-(2**31), 2**31 - 1), st.tuples(*[DOUBLES] * 6), st.booleans(), st.integers(0, 2**64 - 1))
def test_what_is_written_by_a_recipe_is_read_by_it(count, joints, on, bits):
    values = {"count": count, "joints": joints, "on": on, "bits": bits}
    (package,) = PackageStream().feed(RECIPE.pack(values))
    assert package.kind == Kind.DATA
    assert RECIPE.unpack(package.payload) == values


@given(st.binary(max_size=400))
def test_any_bytes_are_packages_or_an_error_that_says_so(data):
    packages = []
    with suppress(ValueError):
        packages.extend(PackageStream().feed(data))
    again = b"".join(struct.pack(">HB", 3 + len(one.payload), one.kind) + one.payload for one in packages)
    assert data.startswith(again)


@given(st.binary(max_size=100))
def test_any_content_is_a_data_package_or_an_error(data):
    try:
        values = RECIPE.unpack(data)
    except ValueError:
        return
    assert data[0] == 3
    assert RECIPE.pack(values)[3:] == data or data[53] > 1  # a truth may be any byte but 0


@given(st.binary(max_size=300))
def test_any_text_message_is_some_text(data):
    assert isinstance(text_of(data), str)


@given(st.binary(max_size=300))
def test_any_robot_state_has_kinematics_none_or_an_error(data):
    try:
        found = kinematics_of(data)
    except ValueError:
        return
    assert found is None or len(found) == 220


def test_kinematics_are_found_behind_other_packages():
    wanted = bytes(range(220))
    state = struct.pack(">IB", 9, 0) + b"abcd" + struct.pack(">IB", 225, 5) + wanted
    assert kinematics_of(state) == wanted


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (b"\x01DOUBLE,NOT_FOUND", "does not know b"),
        (b"\x01IN_USE,DOUBLE", "another program writes a"),
        (b"\x01DOUBLE", "2 variables were asked for, the answer has 1"),
        (b"\x01DOUBLE,QUATERNION", "does not have: QUATERNION"),
        (b"", "is empty"),
    ],
)
def test_a_recipe_that_is_not_given_says_which_variable(answer, says):
    with pytest.raises(ValueError, match=says):
        recipe_of(("a", "b"), answer)
