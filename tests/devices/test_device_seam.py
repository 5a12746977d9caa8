"""What campaigns rely on at the seam: joints at a time between samples, errors that travel."""

from __future__ import annotations

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl import devices
from cellctl.devices import DeviceError, ProbeNotOpen, SearchEnd, SearchResult

MS = 1_000_000


def searched(times, rows) -> SearchResult:
    return SearchResult(SearchEnd.STOPPED, tuple(times), tuple(rows), rows[-1], 3, 0, 0, 0)


def test_joints_between_two_samples_are_on_the_line_between_them():
    result = searched((0, 4 * MS, 8 * MS), [(0.0, 10.0), (1.0, 10.0), (3.0, 9.0)])
    assert result.joints_at(1 * MS) == (0.25, 10.0)
    assert result.joints_at(6 * MS) == (2.0, 9.5)


def test_joints_at_a_sample_are_that_sample():
    result = searched((0, 4 * MS, 8 * MS), [(0.0,), (1.0,), (3.0,)])
    assert [result.joints_at(t) for t in (0, 4 * MS, 8 * MS)] == [(0.0,), (1.0,), (3.0,)]


@pytest.mark.parametrize("time_ns", [-1, 8 * MS + 1])
def test_a_time_outside_the_search_is_refused_not_extrapolated(time_ns):
    with pytest.raises(ValueError, match="outside"):
        searched((0, 8 * MS), [(0.0,), (1.0,)]).joints_at(time_ns)


def test_a_search_of_one_sample_has_no_joints_between():
    with pytest.raises(ValueError, match="outside"):
        searched((0,), [(0.0,)]).joints_at(0)


@given(st.lists(st.integers(0, 50), min_size=2, max_size=20), st.data())
def test_joints_never_leave_the_samples_around_even_where_two_have_one_time(gaps, data):
    times = [sum(gaps[:n]) for n in range(len(gaps))]
    rows = [(float(n),) for n in range(len(gaps))]
    time_ns = data.draw(st.integers(times[0], times[-1]))
    (value,) = searched(times, rows).joints_at(time_ns)
    around = (
        [n for n in range(len(times)) if times[n] <= time_ns][-1],
        next(n for n in range(len(times)) if times[n] >= time_ns),
    )
    assert min(around) <= value <= max(around)


ERRORS = [kind for kind in vars(devices).values() if isinstance(kind, type) and issubclass(kind, DeviceError)]


@pytest.mark.parametrize("kind", ERRORS)
def test_a_device_error_survives_the_way_between_processes(kind):
    error = pickle.loads(pickle.dumps(kind("probe", "is gone", "plug it in")))
    assert (type(error), error.device, error.what, error.cure) == (kind, "probe", "is gone", "plug it in")
    assert str(error) == "probe: is gone\n    plug it in"


def test_an_error_without_a_cure_is_one_line():
    assert str(ProbeNotOpen("probe", "is closed")) == "probe: is closed"
