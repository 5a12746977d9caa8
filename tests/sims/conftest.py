"""The time of simulators that a test steps itself."""

import gc

import pytest

from sims.kernel import Kernel


@pytest.fixture(scope="module", autouse=True)
def what_other_tests_left():
    """Is not looked at: a kernel collects garbage each half second, which would take longer than that."""
    gc.freeze()


@pytest.fixture
def kernel():
    kernel = Kernel("lockstep")
    yield kernel
    kernel.close()
