"""The description of this driver: its entry point."""

from __future__ import annotations

from pathlib import Path

from cellctl.devices import Address, CompensatedRobot, DriverDescription, Surroundings, host_places
from drivers.kuka_rsi.controller_files.generate import controller_files
from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.cyclic.online_limits import OnlineLimits, of_each
from drivers.kuka_rsi.ethernet_config import read_ethernet_config
from drivers.kuka_rsi.robot.kuka_robot import KukaRobot
from drivers.kuka_rsi.settings import RsiSettings
from drivers.kuka_rsi.setup_check import findings


def open_robot(name: str, address: Address, surroundings: Surroundings) -> CompensatedRobot:
    """The robot at `kuka+rsi://BIND_HOST:BIND_PORT?ethernet=FILE&eki=HOST:PORT[&mode=absolute&cycle=ipo_fast]`.

    Opens nothing. `mode` is `absolute` or `relative`, `cycle` is `ipo_fast` (4 ms) or `ipo` (12 ms), both as the
    controller's program passes them to RSI_ON; `correction` and `stop` are tags (AK, Stop); `controller` is the address
    that telegrams come from, if it is not the host of `eki`; `tolerance` is the ETHERNET object's `Timeout`.
    `surroundings.limits` may set `correction_deg`, `speed_deg_s`, `acceleration_deg_s2`, `jerk_deg_s3` and
    `travel_deg`, up to ceilings that follow from `surroundings.reach_mm`, and those of an on-line correction:
    `online_correction_deg`, `online_rate_deg_s`, `online_acceleration_deg_s2`. Raises ValueError for an error in the
    address, an unknown limit or one above its ceiling.
    """
    search, corrections = of_each(surroundings.limits)
    limits = SearchLimits.from_settings(search, surroundings.reach_mm)
    online = OnlineLimits.from_settings(corrections)
    return KukaRobot(name, RsiSettings.of(address, surroundings.folder), surroundings.clock, limits, online)


def check_address(address: Address, folder: Path) -> list[str]:
    """Every error in the address and in the Ethernet configuration that it names; opens no socket.

    `folder`: base of relative paths in the address. Each entry is a line for a person, `file:line: what`.
    """
    try:
        settings = RsiSettings.of(address, folder)
    except ValueError as error:
        return [str(error)]
    return read_ethernet_config(settings).errors


def _places(address: Address) -> frozenset[str]:
    """The port of EthernetKRL, and the controller, which a variable proxy reaches by another port."""
    settings = RsiSettings.of(address, Path())
    return host_places(*settings.eki) | host_places(settings.eki[0]) | host_places(settings.heard)


DRIVER = DriverDescription(open_robot, KukaRobot, check_address, findings, controller_files, _places)
