"""What a run was made with: versions of the main libraries, and a hash of our own code."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from cellctl import __version__

_LIBRARIES = ("numpy", "scipy", "pyserial", "pydantic", "ruckig")
_PACKAGES = ("cellctl", "drivers", "procedures")


def versions() -> dict[str, str]:
    """Name → version: cellctl, Python and the libraries that a result depends on."""
    found = {"cellctl": __version__, "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found


def code_hash() -> str:
    """SHA-256 over every Python source of ours, by name and content: the same code, the same hash."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        spec = find_spec(package)
        for folder in spec.submodule_search_locations or () if spec else ():
            root = Path(folder)
            for file in sorted(root.rglob("*.py")):
                digest.update(f"{package}/{file.relative_to(root).as_posix()}\0".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()
