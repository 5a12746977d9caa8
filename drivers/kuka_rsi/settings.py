"""The settings in the address of a KUKA robot."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Self, final

from cellctl.devices import Address, impossible_host
from drivers.kuka_rsi.cyclic.session import DEFAULT_TOLERANCE, InterpolationCycle, default_tolerance, highest_tolerance
from drivers.kuka_rsi.cyclic.telegram import CorrectionMode

_SETTINGS = {"ethernet", "eki", "correction", "stop", "mode", "cycle", "controller", "tolerance"}
_CYCLES = ", ".join(f"{cycle} ({cycle.milliseconds} ms)" for cycle in InterpolationCycle)


@final
@dataclass(frozen=True, slots=True)
class RsiSettings:
    """The addresses of the two channels and the names of the tags in the telegram.

    `bind`: host and port for the controller's telegrams (port 0: any free one); `ethernet`: the RSI Ethernet
    configuration file that the controller loads; `eki`: the controller's EthernetKRL host and port; `correction`:
    prefix of the six dotted tags (`AK.A1` … `AK.A6`); `stop`: the BOOL tag wired to the STOP object; `mode`,
    `cycle`: as the controller's program passes them to RSI_ON; `controller`: the only accepted address of telegrams
    (empty: the host of `eki`); `tolerance`: cycles without an answer after which the controller stops, `Timeout` of its
    ETHERNET object. A smaller one here ends sessions that the controller would have continued; a larger one
    misses that the controller has ended RSI in a gap.
    """

    bind: tuple[str, int]
    ethernet: Path
    eki: tuple[str, int]
    correction: str = "AK"
    stop: str = "Stop"
    mode: CorrectionMode = CorrectionMode.ABSOLUTE
    cycle: InterpolationCycle = InterpolationCycle.IPO_FAST
    controller: str = ""
    tolerance: int = DEFAULT_TOLERANCE

    @property
    def heard(self) -> str:
        """The host whose telegrams are accepted."""
        return self.controller or self.eki[0]

    @classmethod
    def of(cls, address: Address, folder: Path) -> Self:
        """The settings in `address`, paths read against `folder`. Raises ValueError with every error."""
        query = address.query
        errors = [f"unknown setting '{key}' ({', '.join(sorted(_SETTINGS))})" for key in query.keys() - _SETTINGS]
        errors += [f"setting '{key}' is missing" for key in ("ethernet", "eki") if not query.get(key)]
        errors += [f"setting '{key}' is empty" for key in ("correction", "stop") if query.get(key) == ""]
        mode = query.get("mode", CorrectionMode.ABSOLUTE)
        cycle = query.get("cycle", InterpolationCycle.IPO_FAST)
        errors += [] if mode in set(CorrectionMode) else [f"mode={mode} is none of {', '.join(CorrectionMode)}"]
        errors += [] if cycle in set(InterpolationCycle) else [f"cycle={cycle} is none of {_CYCLES}"]
        stated = InterpolationCycle(cycle) if cycle in set(InterpolationCycle) else InterpolationCycle.IPO_FAST
        tolerance = query.get("tolerance", str(default_tolerance(stated)))
        errors += _about_the_controller(query.get("controller")) + _about_tolerance(tolerance, stated)
        errors += [] if address.host else ["the host to bind is missing (0.0.0.0 binds every network)"]
        eki = _host_and_port(query.get("eki", ""))
        if query.get("eki") and eki is None:
            errors.append(f"eki={query['eki']} is not HOST:PORT")
        if eki and (why := impossible_host(eki[0], reached=True)):
            errors.append(f"eki={query['eki']}: {why}")
        if errors or eki is None:
            raise ValueError(f"{address}: {'; '.join(errors)}")
        names = {key: query[key] for key in ("correction", "stop", "controller") if key in query}
        return cls(
            (address.host, address.port or 0),
            folder / query["ethernet"],
            eki,
            **names,
            mode=CorrectionMode(mode),
            cycle=InterpolationCycle(cycle),
            tolerance=int(tolerance),
        )


def _about_the_controller(text: str | None) -> list[str]:
    try:
        ip_address("127.0.0.1" if text is None else text)
    except ValueError:
        return [f"controller={text} is no IP address (the one that the telegrams come from)"]
    return []


def _about_tolerance(text: str, cycle: InterpolationCycle) -> list[str]:
    highest = highest_tolerance(cycle)
    if text.isascii() and text.isdigit() and len(text) < 5 and 0 < int(text) <= highest:
        return []
    return [f"tolerance={text} is no number of cycles within 1 … {highest} (0.5 s at {cycle.milliseconds} ms)"]


def _host_and_port(text: str) -> tuple[str, int] | None:
    host, colon, port = text.rpartition(":")
    if not (host and colon and port.isascii() and port.isdigit() and 0 < int(port) < 65536):
        return None
    return host.strip("[]"), int(port)
