"""KRG: Meng et al. 2024, doi 10.3390/app142411682: its statements on simulated robots."""

from __future__ import annotations

from tests.studies.papers.kriging_numbers import CELL, PLAY, STIFF, TURNED, WARMER, WITHOUT, study
from tests.studies.papers.statements import Figure, Ordering, Paper, Section

PREDICTION = (
    Figure("robot error, mean of the held-out poses, mm", "4.96", "nominal_mean", 2),
    Figure("kriging, joint weights by particle filter: mean, mm", "0.089", "filtered_mean"),
    Figure("the same: largest, mm", "0.172", "filtered_max"),
    Figure("kriging, W_init: mean, mm", "–", "initial_mean"),
    Figure("the same: largest, mm", "–", "initial_max"),
    Figure("kriging, the paper's optimum of W: mean, mm", "–", "published_mean", note="found for its robot"),
    Figure("kriging, all weights 1: mean, mm", "–", "isotropic_mean"),
    Figure("perceptron on Cartesian position: mean, mm", "0.212", "perceptron_mean", note="tuned by cross-validation"),
    Figure("the same: largest, mm", "0.359", "perceptron_max"),
    Figure("grid, inverse distance: mean, mm", "0.502", "grid_mean", note="tuned by cross-validation"),
    Figure("the same: largest, mm", "0.942", "grid_max"),
    Figure("ours, `--model auto`: mean, mm", "0.089", "ours_mean"),
    Figure("the same: largest, mm", "0.172", "ours_max"),
    Figure("the same: RMS ÷ floor of noise and play", "–", "ours_ratio", 2),
    Figure("our field alone, without geometry: mean, mm", "–", "field_mean"),
    Figure("geometry alone: mean, mm", "–", "geometry_mean"),
    Figure("geometry + compliance: mean, mm", "–", "compliance_mean"),
    Figure("floor: mean, mm", "–", "floor_mean"),
    Figure("floor: largest, mm", "–", "floor_max"),
)
ORDERED = (
    Ordering("kriging < perceptron on position, mean", "0.089 < 0.212", "filtered_mean", "perceptron_mean"),
    Ordering("perceptron < grid, mean", "0.212 < 0.502", "perceptron_mean", "grid_mean"),
    Ordering("kriging over the joints < over positions, mean", "–", "isotropic_mean", "cartesian_mean"),
    Ordering("weights by particle filter < all weights 1, mean", "–", "filtered_mean", "isotropic_mean"),
    Ordering("weights by particle filter < W_init, mean", "–", "filtered_mean", "initial_mean"),
    Ordering("W_init < all weights 1, mean", "implied", "initial_mean", "isotropic_mean", worlds=tuple(WITHOUT)),
    Ordering("ours < the paper's kriging, mean", "–", "ours_mean", "filtered_mean"),
    Ordering("ours < the paper's kriging, largest", "–", "ours_max", "filtered_max"),
)
COMPENSATION = (
    Figure("robot error before, largest, mm", "4.96", "nominal_max", 2, "the paper does not say mean or largest"),
    Figure("after cyclic search with kriging, mean, mm", "–", "filtered_compensated_mean"),
    Figure("after cyclic search with kriging, largest, mm", "0.28", "filtered_compensated_max"),
    Figure("after cyclic search with ours, mean, mm", "–", "ours_compensated_mean"),
    Figure("after cyclic search with ours, largest, mm", "0.28", "ours_compensated_max"),
    Figure(f"with kriging, `{WARMER}`, largest, mm", "0.28", f"{WARMER}/filtered_compensated_max"),
    Figure("with kriging, `backlash: 1`, largest, mm", "0.28", f"{PLAY}/filtered_compensated_max"),
    Figure("with ours, `backlash: 1`, largest, mm", "0.28", f"{PLAY}/ours_compensated_max"),
    Ordering("after < before, largest", "0.28 < 4.96", "filtered_compensated_max", "nominal_max", 2),
    Ordering(
        "predicted < after compensation, largest",
        "0.172 < 0.28",
        "filtered_max",
        "filtered_compensated_max",
        worlds=(PLAY, WARMER),
        note="play is in both numbers: each pose is reached by another way than its neighbours",
    ),
)
PUBLISHED = {
    "unloaded_fixed": ("0.469", "0.440"),
    "loaded_fixed": ("0.424", "0.381"),
    "unloaded_varied": ("0.472", "0.214"),
    "loaded_varied": ("0.403", "0.226"),
}


def _correlations() -> tuple[Figure | Ordering, ...]:
    figures_of = [
        Figure(f"{name}, {kind.replace('_', ', orientation ')}", value, f"{space}_{kind}", 2)
        for kind, values in PUBLISHED.items()
        for (space, name), value in zip((("joints", "De–Dq"), ("places", "De–Dp")), values, strict=True)
    ]
    tests = [Figure(f"p of a Mantel test, De–Dq, {load}, varied", "–", f"joints_{load}_varied_p") for load in LOADS]
    wider = [
        Figure(f"{name}, loaded, {TURNED}", "–", f"{TURNED}/{space}_loaded_varied", 2)
        for space, name in (("joints", "De–Dq"), ("places", "De–Dp"))
    ]
    falls = [
        Ordering(
            f"De–Dp falls when the orientation varies, {load}",
            paper,
            f"places_{load}_varied",
            f"places_{load}_fixed",
            2,
        )
        for load, paper in LOADS.items()
    ]
    less = [
        Ordering(
            f"De–Dp < De–Dq when the orientation varies, {load}",
            f"{PUBLISHED[f'{load}_varied'][1]} < {PUBLISHED[f'{load}_varied'][0]}",
            f"places_{load}_varied",
            f"joints_{load}_varied",
            2,
            (TURNED, STIFF),
        )
        for load in LOADS
    ]
    return (*figures_of, *tests, *wider, *falls, *less)


LOADS = {"unloaded": "0.214 < 0.440", "loaded": "0.226 < 0.381"}

PAPER = Paper(
    tag="krg",
    title="Meng et al. 2024: kriging of position errors in configuration space",
    cell=CELL,
    study=study,
    sections=(
        Section("Prediction: 160 points, 80 held out", (*PREDICTION, *ORDERED)),
        Section("Compensation of the 80 held-out poses", COMPENSATION),
        Section("Spatial similarity: correlation of distances", _correlations()),
    ),
)
