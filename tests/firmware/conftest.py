"""The bench and the firmware, built once; without the tools these tests are skipped, but never where CI runs them."""

import fcntl
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.firmware.rigs import FirmwareRig, Images, SimulatorRig

HERE = Path(__file__).parent
REQUIRED = "CELLCTL_FIRMWARE_TOOLS"
"""The environment's variable that `.ci/run` sets to `required`."""


@pytest.fixture(scope="session")
def images() -> Images:
    """Paths of the bench, the firmware and the self-test. `make` builds them in `tests/firmware/build`."""
    missing = [tool for tool in ("avr-gcc", "gcc", "make") if not shutil.which(tool)]
    if not Path("/usr/include/simavr/sim_avr.h").exists():
        missing.append("libsimavr-dev")
    if missing and os.environ.get(REQUIRED) != "required":
        pytest.skip(f"{' and '.join(missing)} missing here; .ci/run has the packages")
    build = HERE / "build"
    build.mkdir(exist_ok=True)
    with (build / "lock").open("w") as lock:  # the workers of a run share the folder
        fcntl.flock(lock, fcntl.LOCK_EX)
        made = subprocess.run(["make", "-C", HERE], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stdout + made.stderr
    return Images(build / "bench", build / "contact_probe.elf", build / "selftest.elf")


@pytest.fixture
def firmware(images):
    """Makes rigs with the firmware."""
    rigs = []

    def make(**settings):
        rigs.append(FirmwareRig(images, **settings))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()


@pytest.fixture(params=["firmware", "simulator"])
def rig(request):
    """Makes rigs of each implementation."""
    return request.getfixturevalue("firmware") if request.param == "firmware" else SimulatorRig
