"""Warnings about a cell file: said on stderr, with place and cure; nothing is refused for them."""

from __future__ import annotations

import sys

from cellctl.cli.ends import SHOWN
from cellctl.devices.cell import Cell


def show_warnings(cell: Cell) -> None:
    """Say what in the cell file is allowed and probably not meant; nothing where all is well."""
    count = len(cell.warnings)
    if count:
        more = [f"… and {count - SHOWN} more"] if count > SHOWN else []
        text = "\n".join([*map(str, cell.warnings[:SHOWN]), *more])
        print(f"cellctl: {count} warning{'s' * (count > 1)}\n{text}", file=sys.stderr)
