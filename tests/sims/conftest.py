"""The time of simulators that a test steps itself."""

from types import SimpleNamespace

import pytest

from sims.kernel import Kernel


@pytest.fixture(scope="module", autouse=True)
def garbage_of_other_tests():
    """Is left to the interpreter. A kernel collects it each half second, which takes longer than that where thousands
    of tests have run in this process before.
    """
    left = SimpleNamespace(disable=lambda: None, enable=lambda: None, isenabled=lambda: True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sims.kernel.gc", left)
        yield


@pytest.fixture
def kernel():
    kernel = Kernel("lockstep")
    yield kernel
    kernel.close()
