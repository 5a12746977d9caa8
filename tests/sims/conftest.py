"""The time of simulators that a test steps itself."""

import pytest

from sims.kernel import Kernel


@pytest.fixture
def kernel():
    kernel = Kernel("lockstep")
    yield kernel
    kernel.close()
