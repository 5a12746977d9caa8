"""A TCP connection that fails says why in words, not in numbers and tuples."""

from __future__ import annotations

import asyncio
import socket

import pytest

from cellctl.clock import WallClock
from cellctl.devices import DeviceUnreachable
from drivers.tcp_connection import connected


def test_a_refused_connection_says_so_in_words() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with pytest.raises(DeviceUnreachable, match=rf"^robot: no channel at 127.0.0.1:{port} \(connection refused\)"):
        asyncio.run(connected("robot", ("127.0.0.1", port), WallClock(), peer="channel", cure="switch it on"))
