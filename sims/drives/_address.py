"""The nodes that the address of the simulated drives states, and the event that they announce."""

from __future__ import annotations

from urllib.parse import parse_qsl, urlsplit

SYNC = "drives.sync"


def nodes_of(address: str) -> tuple[int, ...]:
    """Node numbers in the order of the axes. Raises ValueError where they are not different numbers of 1 … 127."""
    text = dict(parse_qsl(urlsplit(address).query)).get("nodes", "")
    try:
        nodes = tuple(int(node) for node in text.split(","))
    except ValueError:
        nodes = ()
    if not nodes or len(set(nodes)) < len(nodes) or not all(1 <= node <= 127 for node in nodes):
        raise ValueError(f"nodes={text} are not different numbers of 1 … 127, one for each axis")
    return nodes
