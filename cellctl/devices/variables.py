"""A controller's own variables and files, by their names on the controller."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from cellctl.devices.protocols import Device


@runtime_checkable
class VariableStore(Device, Protocol):
    """A controller whose variables can be read and written. Values are text in the controller's own language."""

    async def read_variable(self, name: str) -> str:
        """The value of a variable: `"{E6AXIS: A1 0.0, …}"`. Raises DeviceRefused, DeviceFault, DeviceLost."""

    async def write_variable(self, name: str, value: str) -> None:
        """Write a variable, read it back and compare.

        Raises DeviceRefused (no such variable, or one that moves the robot), DeviceFault (they differ), DeviceLost.
        """


@runtime_checkable
class FileStore(Device, Protocol):
    """A controller whose files can be read and written, by paths as it has them."""

    async def read_file(self, path: str) -> bytes:
        """The content of a file. Raises DeviceRefused, DeviceFault, DeviceLost."""

    async def write_file(self, path: str, content: bytes) -> None:
        """Write a file, read it back and compare. Raises DeviceRefused, DeviceFault (they differ), DeviceLost."""
