"""Robot-calibration cell controller: campaigns over the devices' own wires, identification, held-out verdict.

The names of `__all__` are public (docs/python.md); all other modules are internal. They are loaded at first use, so
that `import cellctl` stays fast. Their types are in `__init__.pyi`.
"""

from importlib import import_module

from cellctl.version import __version__

__all__ = [
    "Comparison",
    "CompensatedProgram",
    "Compensation",
    "Data",
    "InputError",
    "Model",
    "Prediction",
    "Robot",
    "Run",
    "__version__",
    "compare",
    "fit",
    "load",
    "open_run",
    "read",
    "robot",
]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'cellctl' has no attribute '{name}'")
    found: object = getattr(import_module("cellctl.facade"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
