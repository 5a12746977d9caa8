"""One side of a comparison: a process that holds its rows ready and fits them once for each request that it is sent.

Starting an interpreter and importing are not timed; two such processes can be asked in turn. No import of cellctl: the
other side runs in an environment that has none.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

Rows: TypeAlias = Mapping[str, Any]
"""q (N, 6), rad; xyz (N, 3), mm; held_out_q, held_out_xyz alike; links (6, 4): alpha, a, theta, d of the MDH table;
base, tool (6,): nominal x, y, z, then turns about z, y, x; sigma: 1 σ of a coordinate as the rows have it, mm."""

Tip: TypeAlias = Callable[[Any], Any]
"""Where an identified robot says its tool is, (N, 3), mm, at q (N, 6), rad."""


def serve(prepare: Callable[[Rows], Callable[..., Tip]]) -> None:
    """Answer each request, arguments of a fit in JSON, with one fit of the rows in the file named on the command line.

    The answer: CPU `seconds` and RMS 3-D errors, mm, on the rows (`residual`) and at exact ones (`held_out`).

    CPU seconds of all threads, not those of the wall: on a shared machine neighbours would be measured too.
    """
    with np.load(sys.argv[1]) as file:
        rows = dict(file)
    fit = prepare(rows)
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        began = time.process_time()
        tip = fit(**request)
        seconds = time.process_time() - began
        residual = _rms(tip(rows["q"]), rows["xyz"])
        held_out = _rms(tip(rows["held_out_q"]), rows["held_out_xyz"])
        print(json.dumps({"seconds": seconds, "residual": residual, "held_out": held_out}), flush=True)


def _rms(said: Any, measured: Any) -> float:
    return float(np.sqrt(np.mean(np.sum((said - measured) ** 2, axis=-1))))
