"""Speed is a ratio: both sides in one run, in turn, on one thread each. A table of the ratios ends the run."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
HEAD = ("what", "ours", "beside it", "ratio", "promised")


@pytest.fixture(scope="session")
def with_pybotics() -> list[str]:
    """The command that runs a script with pybotics beside it, fetched where need be; skips where there is none."""
    uv = shutil.which("uv")
    if uv is None:
        pytest.skip("pybotics runs in an environment that uv makes, and uv is not installed")
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    command = [uv, "run", "-q", "--isolated", "--no-project", "--no-build", "--python", python]
    command += ["--with-requirements", str(HERE / "pybotics-requirements.txt")]
    tried = subprocess.run(
        [*command, "python", "-c", "import pybotics"], capture_output=True, text=True, timeout=240, check=False
    )
    if tried.returncode:
        why = " ".join(tried.stderr.split())[-300:]
        pytest.skip(f"no pybotics: {why}")
    return [*command, "python"]


@pytest.fixture
def tell(record_property: Callable[[str, Any], None]) -> Callable[..., None]:
    """Puts a line in the table: what, ours, what is beside it, the ratio, and what is promised of it."""
    return lambda *cells: record_property("speed", dict(zip(HEAD, cells, strict=True)))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """The table, of all workers; also of benchmarks that failed."""
    reports = [report for end in ("passed", "failed") for report in terminalreporter.stats.get(end, [])]
    told = [cells for each in reports for name, cells in getattr(each, "user_properties", ()) if name == "speed"]
    if not told:
        return
    rows = [dict(zip(HEAD, HEAD, strict=True)), *told]
    widths = {name: max(len(row[name]) for row in rows) for name in HEAD}
    terminalreporter.section("speed, side by side in this run")
    for row in rows:
        terminalreporter.write_line("  ".join(row[name].ljust(widths[name]) for name in HEAD).rstrip())
