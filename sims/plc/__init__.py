"""The cell's PLC: a Modbus TCP server on the loopback, its program in the background."""

from sims.plc._description import SIMULATOR

__all__ = ["SIMULATOR"]
