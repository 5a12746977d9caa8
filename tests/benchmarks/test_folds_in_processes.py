"""How much sooner a fit with folds is there when several processes compute them, and that it is the same fit."""

from __future__ import annotations

import time

import numpy as np
import pytest

from cellctl.operations.fitting import fit_rows
from cellctl.operations.fold_processes import processors
from cellctl.operations.studies import fit_units

UNIT = {**fit_units.SETTINGS, "robot": "ur10", "model": "geometry+compliance", "rows": 600, "folds": 8, "seed": 1}


@pytest.mark.long
def test_folds_in_several_processes_beside_one(tell, monkeypatch):
    several = max(processors(), 2)

    def measured(count):
        monkeypatch.setattr(
            fit_units, "fit_rows", lambda *given, **more: fit_rows(*given, **{**more, "processes": count})
        )
        began = time.perf_counter()
        found = fit_units.measure(".", ".", "none", **UNIT)
        return time.perf_counter() - began, found

    (one, alone), (many, divided) = map(measured, (1, several))
    tell(
        f"fit with 8 folds in {several} processes", f"{many:.1f} s", f"in one: {one:.1f} s", f"{one / many:.2f} ×", "–"
    )
    np.testing.assert_equal(divided, alone)
