"""For all tests: what takes long runs with `--long` alone; one thread of linear algebra, as on the command line.

Workers take whole files (`--dist loadfile`), so that what a file's tests share is computed once, and begin with those
that take longest, so that none is left with one at the end.

Hypothesis tries the same examples in every run, and measures no time: what passes on one machine passes on a busy one.
To look for examples that nobody has tried yet: `pytest --hypothesis-profile explore`.
"""

import gc
import os
import signal
import sys
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# Most of a short child's time would be the compilation of its modules, where the environment forbids to keep them.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A shell starts background jobs with SIGINT ignored, nohup with SIGHUP. A child inherits that, and a test that
# interrupts it would wait for ever. A handler is not inherited: pytest ignores the signal, its children do not.
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, lambda *_: None)

settings.register_profile("explore", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("repeat", settings.get_profile("explore"), derandomize=True, database=None)
settings.load_profile("repeat")


@pytest.fixture(scope="session", autouse=True)
def locks_of_this_worker(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Tests that run side by side name the same devices in their cell files: each worker has locks of its own."""
    os.environ["CELLCTL_LOCKS"] = str(tmp_path_factory.mktemp("locks"))


ABOUT_MS = {(True, True): 20_000, (True, False): 8_000, (False, True): 3_000, (False, False): 60}
"""What a test takes, by whether it is marked `long` and `campaign`."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int | None:
    """More workers than processors: many tests wait, for a process, a device or a clock. xdist's own variable wins."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return processors * 3 // 2


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--long`: everything, that is, with what takes long."""
    parser.addoption("--long", action="store_true", help="run what takes long, too (20 minutes to 1½ hours)")


def pytest_collection_finish() -> None:
    """Seven thousand tests and what they import stay to the end: the collector of garbage need not look at them."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what takes long, unless asked; the files that take longest come first."""
    if not config.getoption("--long"):
        left_out = [item for item in items if item.get_closest_marker("long")]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("long")]
    expected_ms: Counter[Path] = Counter()
    for item in items:
        marks = (item.get_closest_marker("long") is not None, item.get_closest_marker("campaign") is not None)
        expected_ms[item.path] += ABOUT_MS[marks]
    items.sort(key=lambda item: -expected_ms[item.path])
