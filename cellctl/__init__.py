"""Robot-calibration cell controller: campaigns over the devices' own wires, identification, held-out verdict."""

__version__ = "0.1.0"
