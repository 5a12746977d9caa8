"""Robot-calibration cell controller: campaigns over the devices' own wires, identification, verdict on held-out rows."""

__version__ = "0.1.0"
