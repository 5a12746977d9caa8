"""Changes of many points: a page that applies them has exactly the wanted points, and gets only what changed."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from cellctl.console.scene._marks import Change, Slots

Held = dict[int, tuple[float, ...]]

NAMES = st.sampled_from([f"touch {number}" for number in range(8)])
POINTS = st.dictionaries(NAMES, st.tuples(st.integers(0, 2).map(float), st.just(0.5)), max_size=8)


def applied(array: list[tuple[float, ...]], change: Change | None) -> list[tuple[float, ...]]:
    """What a page does with a change: values at places, then the first `length` of them."""
    if change is None:
        return array
    array = [*array, *[()] * max(0, change.length - len(array))]
    for index, place in enumerate(change.places):
        array[place] = tuple(change.values[2 * index : 2 * index + 2])
    return array[: change.length]


@given(st.lists(POINTS, max_size=6))
def test_a_page_that_applies_every_change_holds_the_wanted_points(steps: list[dict[str, tuple[float, ...]]]) -> None:
    slots, page = Slots(), []
    for wanted in steps:
        page = applied(page, slots.update(wanted))
        assert sorted(page) == sorted(wanted.values())
        assert [number for value in page for number in value] == slots.values


@given(POINTS)
def test_the_same_points_again_are_no_change(wanted: dict[str, tuple[float, ...]]) -> None:
    slots = Slots()
    slots.update(wanted)
    assert slots.update(dict(wanted)) is None


def test_one_new_point_among_ten_thousand_is_one_place() -> None:
    slots = Slots()
    points = {f"touch {number}": (float(number), 0.0) for number in range(10_000)}
    slots.update(points)
    change = slots.update({**points, "touch 10000": (1.0, 2.0)})
    assert change == Change(10_001, [10_000], [1.0, 2.0])


def test_a_point_removed_from_ten_thousand_moves_one_other() -> None:
    slots = Slots()
    points = {f"touch {number}": (float(number), 0.0) for number in range(10_000)}
    slots.update(points)
    del points["touch 7"]
    assert slots.update(points) == Change(9_999, [7], [9_999.0, 0.0])
