"""KUKA controller with RSI (searches, each interpolation cycle) and an EthernetKRL channel (point-to-point moves).

What is imported here is imported by the cyclic process too: keep it to what names and types need.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cellctl.devices import Address, CompensatedRobot, Surroundings

__all__ = ["check_address", "generate_controller_files", "open_robot"]


def open_robot(name: str, address: Address, surroundings: Surroundings) -> CompensatedRobot:
    """The robot at `kuka+rsi://BIND_HOST:BIND_PORT?ethernet=FILE&eki=HOST:PORT[&correction=AK&stop=Stop&mode=absolute]`.

    Opens nothing. `mode` is `absolute` or `relative`, as the controller's program passes it to RSI_ON; `controller` the
    address that telegrams come from, where it is not the host of `eki`; `tolerance` the ETHERNET object's `Timeout`.
    `surroundings.limits` may set `correction_deg`, `speed_deg_s`, `acceleration_deg_s2`, `jerk_deg_s3` and
    `travel_deg`. Raises ValueError for a mistake in the address or an unknown limit.
    """
    from drivers.kuka_rsi.limits import SearchLimits
    from drivers.kuka_rsi.robot import KukaRobot
    from drivers.kuka_rsi.settings import RsiSettings

    limits = SearchLimits.from_settings(surroundings.limits)
    return KukaRobot(name, RsiSettings.of(address, surroundings.folder), surroundings.clock, limits)


def check_address(address: Address, folder: Path) -> list[str]:
    """Every mistake in the address and in the Ethernet configuration that it names; opens no socket.

    `folder`: against which paths in the address are read. Each entry is a line for a person, `file:line: what`.
    """
    from drivers.kuka_rsi.ethernet_config import read_ethernet_config
    from drivers.kuka_rsi.settings import RsiSettings

    try:
        settings = RsiSettings.of(address, folder)
    except ValueError as error:
        return [str(error)]
    return read_ethernet_config(settings).mistakes


def generate_controller_files(cell: str, address: Address, folder: Path, limits: dict[str, float]) -> dict[str, str]:
    """File name → text of what a person loads on the controller for the cell named `cell`.

    Raises ValueError with what is wrong with the address, the Ethernet configuration it names, or the limits.
    """
    from drivers.kuka_rsi.controller_files.generate import controller_files

    return controller_files(cell, address, folder, limits)
