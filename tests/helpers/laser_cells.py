"""The shipped robot's cell with a laser station, three nests and a reflector on the flange."""

from __future__ import annotations

from pathlib import Path

import yaml

TRACKER = "geocom+serial:///dev/ttyUSB0?baud=115200&accuracy=tdra6000"
STATION = {
    "xyz": [3200, -1500, 900],
    "abc": [30, 0, 0],
    "nests": [
        {"id": "N1", "xyz": [1800, 900, 100]},
        {"id": "N2", "xyz": [1500, -1500, 400]},
        {"id": "N3", "xyz": [200, -2200, 700]},
    ],
}
REFLECTORS = {"constant_mm": -3.8, "on_flange": [{"id": "R1", "xyz": [-60, -80, 80], "facing": [-0.6, -0.54, 0.59]}]}


def write_cell(root: Path, folder: Path, devices: dict[str, str] | None = None, **simulate: object) -> Path:
    """A cell file in `folder`, with the model of the repository `root`."""
    shipped = root / "procedures/cells/sphere_cell.yaml"
    cell = yaml.safe_load(shipped.read_text())
    cell["model"] = str(shipped.parent / cell["model"])
    cell["devices"] = devices or {"tracker": TRACKER}
    cell["limits"] = {}
    cell["station"], cell["reflectors"], cell["simulate"] = STATION, REFLECTORS, simulate
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(cell))
    return path
