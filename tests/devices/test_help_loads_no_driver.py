"""`--help` answers at once: it loads no driver, no step, and no library that only they need."""

from __future__ import annotations

import subprocess
import sys

import pytest

ONLY_FOR_DEVICES = {"drivers", "procedures", "ruckig", "serial"}


@pytest.mark.long
@pytest.mark.parametrize("verb", [[], ["run"], ["table", "push"]], ids=" ".join)
def test_help_loads_no_driver(verb: list[str]) -> None:
    command = [sys.executable, "-X", "importtime", "-m", "cellctl", *verb, "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0
    assert "Usage" in done.stdout
    loaded = {line.rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines() if line.startswith("import time:")}
    assert "typer" in loaded
    assert {name.partition(".")[0] for name in loaded} & ONLY_FOR_DEVICES == set()
