"""The health of the controller behind the proxy, as text and figures."""

from __future__ import annotations

from cellctl.devices import DeviceRefused, Health
from drivers.kuka_varproxy.line import ProxyLine
from drivers.kuka_varproxy.readiness import ControllerState, require_version
from drivers.kuka_varproxy.variables import Variables


async def health_of(device: str, variables: Variables, line: ProxyLine) -> Health:
    """In order if the controller reports all that a move needs. Raises DeviceFault, DeviceLost."""
    try:
        await require_version(device, variables)
        state = await ControllerState.read(variables)
    except DeviceRefused as refused:
        return Health(False, f"{refused.what}: the generated program is not there, or not the one of this driver")
    found = state.obstacles()
    figures = {"latency_ms": line.latency_s * 1e3}
    return Health(not found, "; ".join(found) or "EXT, program runs, drives on", figures)
