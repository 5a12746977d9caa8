"""What can go wrong with a device, named by what the caller can do about it."""

from __future__ import annotations


class DeviceError(Exception):
    """A device did not do what it was asked. `device` names it, `cure` says what to do; exit code 3."""

    def __init__(self, device: str, what: str, cure: str = "") -> None:
        self.device = device
        self.what = what
        self.cure = cure
        super().__init__(device, what, cure)  # all of it, so that it can be sent from process to process

    def __str__(self) -> str:
        return f"{self.device}: {self.what}" + (f"\n    {self.cure}" if self.cure else "")


class DeviceUnreachable(DeviceError):
    """It could not be connected to; nothing has moved."""


class DeviceLost(DeviceError):
    """It was connected and is gone, or silent for too long; what it did last is uncertain."""


class DeviceUncertain(DeviceLost):
    """Something that moves or writes was cut off and nobody knows how far it got; a person has to look. Exit code 4."""


class DeviceRefused(DeviceError):
    """It answered, and said no; nothing has moved because of this request."""


class DeviceFault(DeviceError):
    """It reports a fault of its own (a controller message, a broken wire); a person has to look."""


class LimitExceeded(DeviceError):
    """What was asked would pass a limit of the lowest layer; it was not sent."""


class NoContact(DeviceError):
    """The search went to its end without contact; the robot is held there. Trying again can be worth it."""


class ProbeNotOpen(DeviceRefused):
    """The probe's loop is closed when it should be armed: it touches something, or is stuck."""
