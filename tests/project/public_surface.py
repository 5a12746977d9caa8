"""Writes the recorded list of the public surface, and its page: `python tests/project/public_surface.py`.

The public surface is what authors of drivers, simulators, steps, campaigns, effects, methods, report sections and pages
may import. All else, apart from `import cellctl` (docs/python.md), may change without notice.
"""

from __future__ import annotations

import enum
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from pydantic import BaseModel

HERE = Path(__file__).parent
RECORD = HERE / "public_surface.txt"
PAGE = HERE.parents[1] / "docs" / "extend" / "public-surface.md"

MODULES = (
    "cellctl.devices",
    "cellctl.clock",
    "cellctl.procedure",
    "cellctl.records",
    "cellctl.files",
    "cellctl.journal",
    "cellctl.operations.campaign_services",
    "cellctl.formats",
    "cellctl.kinematics",
    "cellctl.calibration",
    "cellctl.planning",
    "cellctl.compensation",
    "cellctl.metrology",
    "cellctl.analysis",
    "cellctl.report",
    "cellctl.console.appearance",
    "cellctl.console.charts",
    "cellctl.console.frame",
    "cellctl.console.scene",
    "cellctl.installed",
    "drivers.serial_port",
    "drivers.tcp_connection",
    "sims.simulator",
    "sims.bench",
    "sims.scene",
    "sims.wires",
)

_ADDRESS = re.compile(r" at 0x[0-9a-f]+")


def names_of(module: ModuleType) -> list[str]:
    """Those of `__all__`; without one, what the module itself defines."""
    stated = getattr(module, "__all__", None)
    if stated is not None:
        return sorted(stated)
    own = (name for name, value in vars(module).items() if getattr(value, "__module__", None) == module.__name__)
    return sorted(name for name in own if not name.startswith("_"))


def recorded() -> str:
    """The list: a line for each function, class, public method, property and constant."""
    return "".join(f"{line}\n" for name in MODULES for line in _lines(importlib.import_module(name)))


def without_docstring() -> list[str]:
    """The functions, classes and public methods that have none of their own."""
    found = []
    for place in MODULES:
        module = importlib.import_module(place)
        for name in names_of(module):
            value = getattr(module, name)
            if inspect.isclass(value):
                found += [f"{place}.{name}.{key}" for key, each in vars(value).items() if _is_bare(value, key, each)]
            if (inspect.isroutine(value) or inspect.isclass(value)) and not value.__doc__:
                found.append(f"{place}.{name}")
    return found


def _is_bare(of: type, name: str, value: object) -> bool:
    """Whether it is a public method or property without docstring; the default of a field is neither."""
    function = value.fget if isinstance(value, property) else value
    own = inspect.isfunction(function) and function.__qualname__ == f"{of.__qualname__}.{name}"
    return own and not name.startswith("_") and not value.__doc__


def _lines(module: ModuleType) -> Iterator[str]:
    for name in names_of(module):
        value, where = getattr(module, name), f"{module.__name__}.{name}"
        if inspect.isroutine(value):
            yield f"{where}{_signature(value)}"
        elif not inspect.isclass(value):
            yield f"{where}: {type(value).__name__}"
        elif getattr(value, "_is_protocol", False):
            yield f"{where}: Protocol"
        elif issubclass(value, enum.Enum):
            yield f"{where}: {' | '.join(str(each.value) for each in value)}"
        elif issubclass(value, BaseModel):
            yield f"{where}({', '.join(value.model_fields)})"
        else:
            yield f"{where}{_signature(value)}"
        if inspect.isclass(value):
            yield from (f"{where}.{line}" for line in _members(value))


def _members(of: type) -> Iterator[str]:
    for name, value in sorted(vars(of).items()):
        if name.startswith("_"):
            continue
        plain = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if inspect.isfunction(plain):
            yield f"{name}{_signature(plain)}"
        elif isinstance(value, property):
            yield name


def _signature(of: Any) -> str:
    try:
        return _ADDRESS.sub("", str(inspect.signature(of)))
    except (TypeError, ValueError):
        return "(...)"


def page() -> str:
    """The page that lists the names."""
    lines = [
        "# The public surface",
        "",
        "What drivers, simulators, steps, campaigns, effects and sections may import. Ours use it alone. All other",
        "modules may change without notice, apart from [`import cellctl`](../python.md). Signatures are recorded in",
        "`tests/project/public_surface.txt`.",
    ]
    for name in MODULES:
        module = importlib.import_module(name)
        about = (inspect.getdoc(module) or "").split("\n\n")[0].replace("\n", " ")
        lines += ["", f"## `{name}`", "", about, "", *_filled([f"`{each}`" for each in names_of(module)])]
    return "\n".join(lines) + "\n"


def _filled(words: list[str]) -> list[str]:
    lines, line = [], ""
    for word in words:
        if len(line) + len(word) > 117:
            lines, line = [*lines, line.rstrip()], ""
        line += f"{word}, "
    return [*lines, line.rstrip(", ") + "."]


if __name__ == "__main__":
    RECORD.write_text(recorded())
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page())
