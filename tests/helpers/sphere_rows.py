"""Rows of the sphere campaign with what a test cares about; all else is plausible."""

from __future__ import annotations

from typing import Any

from cellctl.records import Figures
from procedures.steps.sphere.rows import (
    DriftFigures,
    ReferenceRow,
    SphereVerdict,
    StandOffRow,
    StopFigures,
    TouchRow,
)

CONTACT: dict[str, Any] = {
    "number": 0,
    "sphere": "S1",
    "resting": (0.1,) * 6,
    "time_ns": 1,
    "time_sigma_ns": 1,
    "tick": 1,
    "bounces": 0,
    "stop_cycles": 2,
    "late": 0,
    "lost": 0,
    "skipped": 0,
    "attempt": 1,
}
STANDOFF: dict[str, Any] = {
    **CONTACT,
    "row": None,
    **dict.fromkeys(("nominal", "commanded", "at_target", "at_contact"), (0.1,) * 6),
    "normal": (0.0, 0.0, 1.0),
    "travel_mm": 10.0,
}
HELD_OUT_SENTENCE = (
    "Error of held-out touches: 0.700 mm before, 0.030 mm after (mean of 30; max 2.000, 0.100 mm). Better than nominal."
)
VERDICT: dict[str, Any] = {
    "verdict": "better",
    "sentence": HELD_OUT_SENTENCE,
    "before": Figures(0.7, 0.9, 2.0),
    "after": Figures(0.03, 0.04, 0.1),
    "model": {"n_fit": 50},
    "drift": DriftFigures(1, 0.0, 0.01, 0.0, False, 0.0, False),
    "stops": StopFigures(0.17, 0.19, 2, 0, 0, 0),
    "noise_scale": 1.25,
}


def touch(**fields: Any) -> TouchRow:
    return TouchRow(**{**CONTACT, "set": "fit", "joints": (0.1,) * 6, **fields})


def reference(shift_mm: float, sigma_mm: float) -> ReferenceRow:
    row = touch(set="reference").data()
    return ReferenceRow(**row, repeats=0, after_touch=1, shift_mm=shift_mm, sigma_mm=sigma_mm)


def standoff(**fields: Any) -> StandOffRow:
    return StandOffRow(**{**STANDOFF, **fields})


def sphere_verdict(**fields: Any) -> SphereVerdict:
    return SphereVerdict(**{**VERDICT, **fields})
