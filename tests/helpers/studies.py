"""Studies of `tests/studies` for the tests that run a small part of them."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any


def load_study(name: str) -> Any:
    """The module `tests/studies/<name>.py`."""
    path = Path(__file__).parents[1] / "studies" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec
    assert spec.loader
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
