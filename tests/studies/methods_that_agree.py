"""Whether spheres and a tracker agree on one robot, by their own covariances; and whether a fault shows.

A KR5 with errors from the prior touches three spheres (80 touches), and a tracker sees a reflector on it (80
positions); each is fitted by itself, and both are compared at 200 places of the touched region
(`calibration.verdict.agreement`). Cases: none; the tracker's scale is wrong; the probe's radius is wrong; both σ are
stated three times too large; joints with errors that the models lack. `docs/results/priors-and-agreement.md` has the
figures; --write replaces them.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from cellctl.calibration.verdict.agreement import DISTANCES, SHARE, Agreement, Calibration, agreement
from tests.helpers.honesty import Fitted, fitted
from tests.helpers.own_model import JointErrors, OwnPositions, OwnTouches, kr5
from tests.helpers.simulated_setups import (
    KR5_SIGNS,
    PRIOR,
    TOUCHED_REGION,
    Draw,
    rows_noisier_than_said,
    seen_by_tracker,
    sph,
)
from tests.studies._runner import Row, Study, Table, each

COUNT, PLACES = 80, 200


def scaled(ppm: float) -> Callable[[Draw, Draw], tuple[Draw, Draw]]:
    """The tracker's lengths are too long."""

    def wrong(touches: Draw, seen: Draw) -> tuple[Draw, Draw]:
        assert isinstance(seen.rows, OwnPositions)
        return touches, replace(seen, rows=replace(seen.rows, xyz=seen.rows.xyz * (1.0 + 1e-6 * ppm)))

    return wrong


def radius(by_mm: float) -> Callable[[Draw, Draw], tuple[Draw, Draw]]:
    """The fit is told another radius of the probe than it has."""

    def wrong(touches: Draw, seen: Draw) -> tuple[Draw, Draw]:
        assert isinstance(touches.rows, OwnTouches)
        return replace(touches, rows=replace(touches.rows, reach=touches.rows.reach + by_mm)), seen

    return wrong


CASES: dict[str, Callable[[Draw, Draw], tuple[Draw, Draw]]] = {
    "none": lambda touches, seen: (touches, seen),
    "tracker 30 ppm": scaled(30.0),
    "tracker 50 ppm": scaled(50.0),
    "tracker 100 ppm": scaled(100.0),
    "tracker 200 ppm": scaled(200.0),
    "probe radius 0.05 mm": radius(0.05),
    "probe radius 0.1 mm": radius(0.1),
    "probe radius 0.3 mm": radius(0.3),
    "both σ stated 3 times too large": lambda touches, seen: (
        rows_noisier_than_said(touches, 1.0 / 3.0),
        rows_noisier_than_said(seen, 1.0 / 3.0),
    ),
    "joint errors that the models lack": lambda touches, seen: (touches, seen),
}


def calibration(found: Fitted) -> Calibration:
    """What a fit identified, as it is compared."""
    best = found.identification.identified
    own = np.s_[: best.unknowns.robot]
    return Calibration(
        best.state.model, best.covariance[own, own], np.where(best.unknowns.free, best.unknowns.sigma, 0.0)[own] ** 2
    )


def compared(seed: int, case: str, count: int = COUNT) -> tuple[Agreement, float]:
    """Both methods on the robot of a seed; and the noise scale of the touches."""
    rng, nominal = np.random.default_rng([seed, 31]), kr5()
    errors = {name: float(rng.normal(0.0, PRIOR.sigma(name, ()))) for name in nominal.link_names}
    besides = JointErrors.drawn(seed) if "lack" in case else None
    q, asked = (rng.uniform(*TOUCHED_REGION, (n, 6)) * KR5_SIGNS for n in (count, PLACES))
    touches = sph(seed, errors=errors, count=count, besides=besides)
    seen = seen_by_tracker(rng, nominal, q, asked, errors=errors, besides=besides)
    a, b = (fitted(draw) for draw in CASES[case](touches, seen))
    return agreement(calibration(a), calibration(b), asked, nominal.tool), a.growth


def units(asked: Namespace) -> Iterator[Row]:
    """Each fault on each robot; half of the robots for the faults."""
    for case in CASES:
        yield from each(case=[case], seed=asked.seeds if case == "none" else asked.seeds[: len(asked.seeds) // 2])


def measure(case: str, seed: int) -> Row:
    """The comparison."""
    found, noise = compared(seed, case)
    assert found.figures is not None
    return {
        "verdict": found.verdict,
        "within": found.figures.within,
        "distance": found.figures.distance,
        "dof": found.degrees_of_freedom,
        "difference": found.figures.difference_rms_mm,
        "sigma": found.figures.sigma_rms_mm,
        "scale": found.figures.scale_ppm,
        "scale_sigma": found.figures.scale_sigma_ppm,
        "noise": noise,
    }


def tables(found: list[Row], asked: Namespace) -> Iterator[Table]:
    """Verdicts and figures of each case."""
    lines = [
        "| fault | robots | agree | not known | disagree | places within the 95 % radius | Mahalanobis distance² per "
        "degree of freedom (mean; least … greatest) | degrees of freedom | difference (mm, RMS) | σ (mm, RMS) "
        "| scale (ppm, mean; its stated σ) | noise of the touches grew (median) |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for case in CASES:
        mine = [row for row in found if row["case"] == case]
        if not mine:
            continue
        distance = np.array([row["distance"] for row in mine])
        verdicts = [row["verdict"] for row in mine]
        within = np.mean([row["within"] for row in mine])
        difference, sigma = (np.sqrt(np.mean([row[key] ** 2 for row in mine])) for key in ("difference", "sigma"))
        cells = (
            *(str(verdicts.count(word)) for word in ("agree", "not known", "disagree")),
            f"{100.0 * within:.1f} %",
            f"{distance.mean():.2f}; {distance.min():.2f} … {distance.max():.2f}",
            f"{np.mean([row['dof'] for row in mine]):.0f}",
            f"{difference:.3f}",
            f"{sigma:.3f}",
            f"{np.mean([row['scale'] for row in mine]):+.0f} ± {np.mean([row['scale_sigma'] for row in mine]):.0f}",
            f"{np.median([row['noise'] for row in mine]):.1f}",
        )
        lines.append("| " + " | ".join([case, str(len(mine)), *cells]) + " |")
    yield Table("\n".join(lines), "methods that agree")


def as_promised(found: list[Row]) -> bool:
    """Whether methods without a fault agree: 90 % of all places within 1, the mean distance in its limits."""
    mine = [row for row in found if row["case"] == "none"]
    within, distance = (float(np.mean([row[key] for row in mine])) for key in ("within", "distance"))
    return within >= SHARE and DISTANCES[0] <= distance <= DISTANCES[1]


STUDY = Study(units, measure, tables, seeds=40, passed=as_promised, writes=True)
