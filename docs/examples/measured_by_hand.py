"""Stands in for a robot and a tracker: NAME.dat, a pendant's list of joints, and NAME.csv, a table of positions.

The robot is the simulators' (`python -m sims truth`), a KR5 R1400 with sagging joints; nothing of cellctl is in it.
"""

import argparse
import csv
import random
import subprocess
import sys
from math import cos, sin
from pathlib import Path

CELL = Path("procedures/cells/sphere_cell.yaml")
RANGES_DEG = [(-60, 60), (-115, -35), (40, 125), (-90, 90), (-80, 80), (-120, 120)]
TRACKER = {"Mo": (0.7, 2100.0, -800.0), "Do": (1.9, -350.0, 2600.0)}
"""Where the tracker stood each day: turned by (rad) and shifted by (mm, mm) against the robot; it looks down 900 mm."""
NOISE_MM = 0.03


def main() -> None:
    """Write both lists for the postures asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", help="of the two lists")
    parser.add_argument("days", nargs="+", choices=TRACKER, help="where the tracker stood, one day after another")
    parser.add_argument("--rows", type=int, default=60, help="a day")
    parser.add_argument("--seed", type=int, default=1, help="other postures, other noise; the same robot")
    parser.add_argument(
        "--lost", type=float, default=0.0, help="by how much A3 reads too little since a crash, degrees"
    )
    asked = parser.parse_args()
    draw = random.Random(asked.seed)
    days = [day for day in asked.days for _ in range(asked.rows)]
    shown = [[round(draw.uniform(*limits), 3) for limits in RANGES_DEG] for _ in days]
    there = true_places([[*row[:2], row[2] + asked.lost, *row[3:]] for row in shown])
    joints = [",".join(f"A{axis} {value}" for axis, value in enumerate(row, 1)) for row in shown]
    typed = [
        [f"P{row}", *seen(place, day, draw), day] for row, (place, day) in enumerate(zip(there, days, strict=True), 1)
    ]
    write(f"{asked.name}.dat", [f"DECL E6AXIS XP{row}={{{words}}}" for row, words in enumerate(joints, 1)])
    write(f"{asked.name}.csv", [";".join(row) for row in [["Punkt", "X [m]", "Y [m]", "Z [m]", "Tag"], *typed]])


def true_places(readings: list[list[float]]) -> list[list[float]]:
    """Where the simulated robot's tool centre point is, mm, at joints in degrees."""
    cell = CELL.read_text().replace("../robots", str(CELL.parent.parent / "robots"))
    write("cell.yaml", [cell.replace("  seed: 1", "  seed: 7\n  errors: {compliance: 1}")])
    write("asked.csv", ["A1,A2,A3,A4,A5,A6", *(",".join(map(str, row)) for row in readings)])
    asked = ["-m", "sims", "truth", "cell.yaml", "asked.csv", "-o", "there.csv"]
    subprocess.run([sys.executable, *asked], check=True)
    with Path("there.csv").open() as file:
        return [[float(row[axis]) for axis in "XYZ"] for row in csv.DictReader(file)]


def seen(place: list[float], day: str, draw: random.Random) -> list[str]:
    """Metres in the tracker's frame, with its noise, as somebody types them."""
    turn, east, north = TRACKER[day]
    x, y, z = (value + draw.gauss(0, NOISE_MM) for value in place)
    moved = (x * cos(turn) - y * sin(turn) + east, x * sin(turn) + y * cos(turn) + north, z - 900)
    return [f"{mm / 1000:.5f}".replace(".", ",") for mm in moved]


def write(name: str, lines: list[str]) -> None:
    """A file of these lines."""
    Path(name).write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
