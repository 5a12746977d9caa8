"""The simulated laser station put together: instrument, procedures, serial line, and its share of the faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, final

from sims.faults import Faults
from sims.geocom._accuracy import PROFILES, baud_of, profile_of
from sims.geocom._instrument import Build, Instrument, Power
from sims.geocom._measuring_rpcs import measuring_procedures
from sims.geocom._motion import Aiming, motion_procedures
from sims.geocom._optics import Sight, nearest
from sims.geocom._session import Receiver, Sender, Session
from sims.geocom._settings_rpcs import settings_procedures
from sims.kernel import Kernel
from sims.scene.scene import Scene
from sims.simulator import Request, Setup, with_path
from sims.wires import Terminal

ANYWHERE_RAD = 10.0


def build_of(address: str, settings: Mapping[str, Any], seed: int) -> Build:
    """The instrument that the cell file describes."""
    profile = PROFILES[settings["noise"] or profile_of(address)]
    others = {name: value for name, value in settings.items() if name not in ("noise", "reply_ms")}
    return Build(seed=seed, profile=profile, **others)


@final
class LaserStation:
    """The instrument with its line: fed with characters, it gives lines to `write` when their last character is out.

    reply_ms: from the end of a request or of its work to its reply.
    """

    def __init__(
        self,
        kernel: Kernel,
        faults: Faults,
        scene: Scene,
        build: Build,
        *,
        baud: int,
        reply_ms: float,
        write: Callable[[bytes], object],
    ) -> None:
        self._faults = faults
        self._sight = Sight(scene, faults)
        self.instrument = instrument = Instrument(kernel, self._sight, build)
        aiming = Aiming(instrument, faults.announce)
        self._sender = Sender(kernel, faults, baud, write)
        session = Session(
            kernel,
            faults,
            instrument,
            {
                **settings_procedures(instrument),
                **motion_procedures(instrument, aiming),
                **measuring_procedures(instrument, faults.announce),
            },
            send=lambda line: self._sender.send(line, round(reply_ms * 1e6)),
            stop=instrument.stop_movement,
        )
        self._receiver = Receiver(
            kernel, baud, line=session.take, clear=session.clear, abort=session.abort, overrun=session.overrun
        )
        faults.on_start("tracker.sleep", lambda: instrument.switch(Power.ASLEEP))
        faults.on_start("tracker.reflector_lost", self._lose_reflector)
        faults.on_start("tracker.wrong_prism", self._choose_prism)

    def feed(self, chunk: bytes) -> None:
        """Characters from the host."""
        self._receiver.feed(chunk)

    def hang_up(self) -> None:
        """The host has closed the line: a request that has begun and replies that are not out are lost."""
        self._receiver.forget()
        self._sender.cut()

    def _lose_reflector(self) -> None:
        """The reflector nearest to the telescope's axis is gone."""
        seen = nearest(self.instrument.targets(), self.instrument.axis(), ANYWHERE_RAD)
        if seen is not None:
            self._sight.lost.add(seen.id)

    def _choose_prism(self) -> None:
        fault, configuration = self._faults.active("tracker.wrong_prism"), self.instrument.configuration
        if fault is not None and fault.settings["prism"] in configuration.prisms:
            configuration.prism_type = fault.settings["prism"]


@final
class GeocomServer:
    """The laser station on its pseudo-terminal."""

    def __init__(self, setup: Setup) -> None:
        self._wire = setup.wire
        self._heard = False
        self._terminal = Terminal(setup.kernel, self._host_speaks, self._host_hangs_up)
        self.station = LaserStation(
            setup.kernel,
            setup.faults,
            setup.scene,
            build_of(setup.address, setup.settings, setup.cell.simulate.seed),
            baud=baud_of(setup.address),
            reply_ms=setup.settings["reply_ms"],
            write=self._write,
        )
        self.address = with_path(setup.address, self._terminal.path)
        self.requests: dict[str, Request] = {}
        noise, part = self.station.instrument.noise, f"tracker {setup.device}"
        setup.memory.recall(part, noise.recall)
        setup.memory.keep(part, noise.state)

    @property
    def path(self) -> str:
        """The terminal that a host opens: `/dev/pts/7`."""
        return self._terminal.path

    def close(self) -> None:
        """Hang up."""
        self._terminal.close()
        self._host_hangs_up()

    def _write(self, line: bytes) -> None:
        self._wire.wrote(len(line) if self._terminal.write(line) else 0)

    def _host_speaks(self, chunk: bytes) -> None:
        if not self._heard:
            self._heard = True
            self._wire.opened()
        self.station.feed(chunk)
        self._wire.read(len(chunk))

    def _host_hangs_up(self) -> None:
        self._heard = False
        self.station.hang_up()
        self._wire.cut()
