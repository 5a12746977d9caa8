"""Errors of devices, named by what the caller can do about them."""

from __future__ import annotations


class DeviceError(Exception):
    """A device did not do what was requested. `device`: its name; `cure`: what to do. Exit code 3."""

    def __init__(self, device: str, what: str, cure: str = "") -> None:
        self.device = device
        self.what = what
        self.cure = cure
        super().__init__(device, what, cure)  # all of it, so that it can be sent from process to process

    def __str__(self) -> str:
        return f"{self.device}: {self.what}" + (f"\n    {self.cure}" if self.cure else "")


class DeviceUnreachable(DeviceError):
    """The connection failed; nothing has moved."""


class DeviceLost(DeviceError):
    """The connection was lost, or the device was silent too long; its last action is uncertain."""


class DeviceUncertain(DeviceLost):
    """A motion or write was interrupted and its extent is unknown; a person must check the cell. Exit code 4."""


class DeviceRefused(DeviceError):
    """The device refused the request; nothing has moved because of it."""


class DeviceFault(DeviceError):
    """The device reports a fault (a controller message, a broken wire); a person must check it."""


class LimitExceeded(DeviceError):
    """The request exceeds a limit of the lowest layer; it was not sent."""


class NoContact(DeviceError):
    """The search reached its end without contact; the robot is held there. A retry can succeed."""


class ProbeNotOpen(DeviceRefused):
    """The probe's loop is closed at arming: the probe touches something, or is stuck."""


class TargetLost(DeviceError):
    """The instrument has no reflector: the beam is broken, or none or several were found. Aiming again can succeed."""


class OutOfRange(DeviceError):
    """The reflector is too near, too far, or turned away too much. Another pose or station can succeed."""


class DeviceBusy(DeviceError):
    """The device is at work on something else. The same request can succeed later."""


class NotLevelled(DeviceFault):
    """The instrument's compensator is off or out of its range: it must be levelled again."""
