"""Benches with a laser station."""

import pytest

from tests.helpers.station import Bench, Scene


@pytest.fixture
def bench(kernel):
    """Makes a bench: reflectors, `scene` fields, and what the instrument is like."""

    def make(*targets, scene=None, **build):
        return Bench(kernel, scene or Scene(list(targets)), **build)

    return make
