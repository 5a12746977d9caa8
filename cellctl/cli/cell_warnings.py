"""Warnings about a cell file: printed on stderr, with place and cure; they do not stop the command."""

from __future__ import annotations

import sys

from cellctl.cli.ends import SHOWN
from cellctl.devices.cell import Cell


def show_warnings(cell: Cell) -> None:
    """Print allowed but probably unintended values in the cell file, if any."""
    count = len(cell.warnings)
    if count:
        more = [f"… and {count - SHOWN} more"] if count > SHOWN else []
        text = "\n".join([*map(str, cell.warnings[:SHOWN]), *more])
        print(f"cellctl: {count} warning{'s' * (count > 1)}\n{text}", file=sys.stderr)
