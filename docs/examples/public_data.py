"""Makes data sets of `cellctl` from public measurements of two real robots (docs/reference/data-sets.md).

python docs/examples/public_data.py measurements_grid.csv 160 -o rows.csv     UR10 and tracker: 160 random poses
    --held-out 3000     further ones as the set `test`, with a column `set`
    --temperature       a column `temperature`
python docs/examples/public_data.py iiwa14_sockets -o rows.csv                iiwa 14: all visits of the sockets
"""

import argparse
import csv
import random
from collections.abc import Iterator
from pathlib import Path

UR10 = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
UR10 += [f"measurement_{axis}" for axis in "xyz"]
TEMPERATURE = "measurement_temperature"


def ur10(file: Path, columns: list[str]) -> Iterator[list[str]]:
    """Joints, rad, and positions of the tracker, mm; in the file with a decimal comma."""
    with file.open(newline="") as source:
        for row in csv.DictReader(source, delimiter=";"):
            yield [row[name].replace(",", ".") for name in columns]


def iiwa14(folder: Path) -> Iterator[list[str]]:
    """Joints, rad, with the ball in a socket, and the place of the plate with the sockets."""
    for place in ("front", "left_back", "raised_left"):
        for socket in ("0", "1"):
            lines = (folder / place / f"hole_{socket}.csv").read_text().split()
            yield from ([*line.split(","), socket, place] for line in lines)


def main() -> None:
    """Write the rows asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path)
    parser.add_argument("rows", type=int, nargs="?", help="how many, at random; default: all")
    parser.add_argument("--held-out", type=int, default=0, help="how many more, which judge")
    parser.add_argument("--temperature", action="store_true", help="with the temperature (UR10)")
    parser.add_argument("--seed", type=int, default=1, help="of the choice")
    parser.add_argument("-o", "--out", type=Path, required=True)
    asked = parser.parse_args()
    if asked.source.is_dir():
        rows, names = [*iiwa14(asked.source)], ["socket", "session"]
    else:
        rows = [*ur10(asked.source, [*UR10, *([TEMPERATURE] if asked.temperature else [])])]
        names = ["X", "Y", "Z", *(["temperature"] if asked.temperature else [])]
    joints = [f"q{joint}" for joint in range(1, len(rows[0]) - len(names) + 1)]
    chosen = random.Random(asked.seed).sample(rows, asked.rows + asked.held_out) if asked.rows else rows
    if asked.held_out:
        names.append("set")
        chosen = [[*row, "fit" if place < asked.rows else "test"] for place, row in enumerate(chosen)]
    with asked.out.open("w", newline="") as target:
        csv.writer(target).writerows([[*joints, *names], *chosen])


if __name__ == "__main__":
    main()
