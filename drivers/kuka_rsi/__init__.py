"""KUKA controller with RSI (searches, each interpolation cycle) and an EthernetKRL channel (point-to-point moves).

What is imported here is imported by the cyclic process too: keep it to what names and types need.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cellctl.devices import Address, CompensatedRobot, Finding, Surroundings

__all__ = ["check_address", "check_setup", "generate_controller_files", "open_robot"]


def open_robot(name: str, address: Address, surroundings: Surroundings) -> CompensatedRobot:
    """The robot at `kuka+rsi://BIND_HOST:BIND_PORT?ethernet=FILE&eki=HOST:PORT[&correction=AK&stop=Stop&mode=absolute]`.

    Opens nothing. `mode` is `absolute` or `relative`, as the controller's program passes it to RSI_ON; `controller` the
    address that telegrams come from, where it is not the host of `eki`; `tolerance` the ETHERNET object's `Timeout`.
    `surroundings.limits` may set `correction_deg`, `speed_deg_s`, `acceleration_deg_s2`, `jerk_deg_s3` and
    `travel_deg`, up to ceilings that follow from `surroundings.reach_mm`. Raises ValueError for a mistake in the
    address, an unknown limit or one above its ceiling.
    """
    from drivers.kuka_rsi.limits import SearchLimits
    from drivers.kuka_rsi.robot import KukaRobot
    from drivers.kuka_rsi.settings import RsiSettings

    limits = SearchLimits.from_settings(surroundings.limits, surroundings.reach_mm)
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


def check_setup(address: Address, surroundings: Surroundings) -> list[Finding]:
    """What is wrong with the limits, and what in limits and address is probably not meant; opens nothing."""
    from drivers.kuka_rsi.setup_check import findings

    return findings(address, surroundings)


def generate_controller_files(
    cell: str, address: Address, folder: Path, limits: dict[str, float], reach_mm: float | None = None
) -> dict[str, str]:
    """File name → text of what a person loads on the controller for the cell named `cell`.

    `folder`, `limits`, `reach_mm` as in `Surroundings`. Raises ValueError with what is wrong with the address, the
    Ethernet configuration it names, or the limits.
    """
    from drivers.kuka_rsi.controller_files.generate import controller_files

    return controller_files(cell, address, folder, limits, reach_mm)
