"""Provenance of a run: versions of the main libraries, the computer, and hashes of the code."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, entry_points, version
from importlib.util import find_spec
from pathlib import Path

from cellctl import __version__
from cellctl.files import sha256_of

_GROUPS = ("cellctl.devices", "cellctl.steps")
_NAMED = 5
"""Maximum number of changed files that are listed."""

_LIBRARIES = ("numpy", "scipy", "pyserial", "pydantic", "ruckig")


def versions() -> dict[str, str]:
    """Name → version: cellctl, Python and the libraries that a result depends on; platform, processor, BLAS kernel."""
    found = {"cellctl": __version__, "python": platform.python_version()}
    found |= {"platform": platform.platform(), "processor": _processor(), "BLAS": _blas()}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found


def sources() -> dict[str, str]:
    """Every Python file of cellctl and of the packages with drivers and steps: name → SHA-256 of its content."""
    points = (point for group in _GROUPS for point in entry_points(group=group))
    packages = {"cellctl", *(point.module.partition(".")[0] for point in points)}
    files = sorted((name, file) for package in packages for name, file in _files(package))
    return {name: sha256_of(file.read_bytes()) for name, file in files}


def changed_sources(before: Mapping[str, str]) -> str:
    """`: a.py, b.py and 3 more`: the files that differ from `before`; empty if unknown."""
    now = sources() if before else {}
    names = sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f": {', '.join(names[:_NAMED])}{more}" if names else ""


def code_hash() -> str:
    """SHA-256 over `sources`: the same code, the same hash."""
    return sha256_of(sources())


def _processor() -> str:
    """The processor's model: linear algebra libraries choose their code by it, which affects the last digits."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, platform.processor() or platform.machine())


def _blas() -> str:
    """Linear algebra libraries of numpy and scipy, each with the kernel that it chose: `openblas 0.3.30 SkylakeX`.

    The processor's model does not decide the kernel alone: a library's version and OPENBLAS_CORETYPE do, too.
    """
    import numpy.linalg  # noqa: F401 - loads its library
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_info

    found = (each for each in threadpool_info() if each["user_api"] == "blas")
    return ", ".join(
        sorted({f"{each['internal_api']} {each['version']} {each.get('architecture', '')}" for each in found})
    )


def _files(package: str) -> Iterator[tuple[str, Path]]:
    spec = find_spec(package)
    folders = spec.submodule_search_locations if spec else None
    if spec and spec.origin and not folders:
        yield f"{package}.py", Path(spec.origin)
    for root in map(Path, folders or ()):
        for file in root.rglob("*.py"):
            yield f"{package}/{file.relative_to(root).as_posix()}", file
