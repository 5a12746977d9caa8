"""Checks whether a driver's class provides what a step needs, before the device is opened."""

from __future__ import annotations

from typing import Any


def missing_abilities(driver: type, protocol: type) -> list[str]:
    """Methods and properties of `protocol` that `driver` lacks, sorted.

    Plain attributes are left out: a driver may set them when it is made.
    """
    return sorted(name for name in _abilities(protocol) if not hasattr(driver, name))


def _abilities(protocol: type) -> set[str]:
    declared: dict[str, Any] = {}
    for base in protocol.__mro__:
        if getattr(base, "_is_protocol", False):
            declared |= vars(base)
    return {name for name, value in declared.items() if not name.startswith("_") and _does_something(value)}


def _does_something(value: Any) -> bool:
    return callable(value) or isinstance(value, property)
