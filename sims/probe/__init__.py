"""The contact probe: a microcontroller that watches the loop, on a serial line that is a pseudo-terminal."""

from sims.probe.server import ProbeServer, start

__all__ = ["ProbeServer", "start"]
