"""Errors of a table's push, in the same words for every controller."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from cellctl.devices.errors import DeviceLost, DeviceRefused, DeviceUncertain
from cellctl.devices.tables import ControllerTable

LOOK = "Connect again and ask which table is active (cellctl table show) before anything relies on one."
"""The cure where it is not known which table is active."""


def refuse_rows(device: str, table: ControllerTable, most: int) -> None:
    """Raise DeviceRefused for a table without rows, or with more than `most`."""
    if not 0 < len(table.rows) <= most:
        raise DeviceRefused(device, f"a table of {len(table.rows)} rows (1 … {most} fit)")


@contextmanager
def lost_before_activation(device: str, table: ControllerTable) -> Iterator[None]:
    """A DeviceLost says that `table` was not activated."""
    try:
        yield
    except DeviceLost as lost:
        what = f"{lost.what}; table {table.id[:12]} was not activated, the old one is in force"
        raise DeviceLost(device, what, lost.cure) from lost


@contextmanager
def lost_in_activation(device: str, uncertain: str) -> Iterator[None]:
    """A DeviceLost becomes DeviceUncertain; `uncertain`: of what, as `whether …`."""
    try:
        yield
    except DeviceLost as lost:
        raise DeviceUncertain(device, f"{lost.what}; uncertain {uncertain}", LOOK) from lost
