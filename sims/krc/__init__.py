"""The controller (KRC) in simulation: one arm in motion, its EKI server and its RSI client, from the wire documents."""

from sims.krc.controller import KrcServers, start
from sims.krc.ethernet_config import BadConfig

__all__ = ["BadConfig", "KrcServers", "start"]
