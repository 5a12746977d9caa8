"""Put this folder on PYTHONPATH: every wire of every process then delays what it carries, at random, in wall time.

Sockets (RSI, EthernetKRL, control port) and serial lines (`os.read`, `os.write`). Each run's delays are others.
"""

import os
import random
import socket
import time

_draw = random.Random(os.urandom(8))
_SHARE = float(os.environ.get("SLOW_WIRES_SHARE", "0.02"))
_LONGEST_S = float(os.environ.get("SLOW_WIRES_LONGEST_S", "0.02"))


def _delayed(carry):
    def slow(*given, **named):
        if _draw.random() < _SHARE:
            time.sleep(_draw.random() ** 3 * _LONGEST_S)  # noqa: TID251 - wall time is what this is about
        return carry(*given, **named)

    return slow


for _name in ("send", "sendall", "sendto", "recv", "recvfrom"):
    setattr(socket.socket, _name, _delayed(getattr(socket.socket, _name)))
os.read, os.write = _delayed(os.read), _delayed(os.write)
