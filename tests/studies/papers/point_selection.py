"""ANN: the paper on point selection, motor currents and a network; its statements on simulated robots."""

from __future__ import annotations

from tests.studies.papers.point_selection_numbers import CELL, RIGID, ROUGH, UNLOADED, WEIGHT, study
from tests.studies.papers.statements import Figure, Ordering, Paper, Section

WORLDS = (WEIGHT, UNLOADED)
NETWORK = "paper_network_mean"

PAPER = Paper(
    tag="ann",
    title="Mathematical Problems in Engineering 2020, 9035425: point selection, motor currents and a network",
    cell=CELL,
    study=study,
    sections=(
        Section(
            "Geometry by 80 quasi-random points, judged at 50 others",
            (
                Figure("before, mm", "5.12", "nominal_mean", 2),
                Figure("POE, mm", "1.81", "paper_poe_mean", 2),
                Figure("DH without β, mm", "2.27", "model_dh_mean", 2),
                Figure("MDH with β, mm", "–", "model_mdh_mean", 2),
                Figure(f"POE, `{WEIGHT}`, mm", "1.81", f"{WEIGHT}/paper_poe_mean", 2),
                Ordering("POE < before", "1.81 < 5.12", "paper_poe_mean", "nominal_mean", 2),
                Ordering("POE < DH without β", "1.81 < 2.27", "model_poe_mean", "model_dh_mean", 4, (RIGID, ROUGH)),
                Ordering("POE < MDH with β", "–", "model_poe_mean", "model_mdh_mean", 4, note="they are equal"),
            ),
        ),
        Section(
            "On the U-shaped path, after training near it",
            (
                Figure("POE alone, mm", "1.81", "paper_path_poe_mean", 2, "the paper's figure is not of the path"),
                Figure("POE + network, mm", "1.23", "paper_network_mean", 2),
                Figure("POE + F·I at the measured currents, mm", "–", "paper_direct_mean", 2),
                Figure("network, arbitrary training points, mm", "1.57", "paper_arbitrary_mean", 2),
                Figure("network, pseudo-random points, mm", "1.53", "pseudo_network_mean", 2),
                *(
                    Figure(f"{what}, `{world}`, mm", paper, f"{world}/{key}", 3)
                    for world in WORLDS
                    for what, paper, key in (
                        ("POE alone", "1.81", "paper_path_poe_mean"),
                        ("POE + network", "1.23", "paper_network_mean"),
                        ("POE + F·I", "–", "paper_direct_mean"),
                    )
                ),
                Ordering("network < POE alone", "1.23 < 1.81", "paper_network_mean", "paper_path_poe_mean", 3, WORLDS),
                Ordering("F·I at the currents < POE alone", "–", "paper_direct_mean", "paper_path_poe_mean", 3, WORLDS),
                Ordering("F·I at the currents < network", "–", "paper_direct_mean", "paper_network_mean", 3, WORLDS),
                Ordering(
                    "near the path < arbitrary", "1.23 < 1.57", "paper_network_mean", "paper_arbitrary_mean", 4, WORLDS
                ),
                Ordering(
                    "Sobol < pseudo-random", "1.23 < 1.53", "paper_network_mean", "pseudo_network_mean", 4, WORLDS
                ),
            ),
        ),
        Section(
            "Ours on the path, from the same 580 points",
            (
                Figure("`auto` with the direction of each last motion: mean, mm", "1.23", "ours_mean"),
                Figure("the same: largest, mm", "–", "ours_max"),
                Figure("the same: RMS ÷ floor", "–", "ours_ratio", 2),
                Figure("`geometry+motor` at the measured currents: mean, mm", "1.23", "motor_mean"),
                Figure("the same: RMS ÷ floor", "–", "motor_ratio", 2, "the floor has no noise of currents"),
                Figure("`auto` with neither: mean, mm", "1.23", "neither_mean"),
                Figure(f"`auto` with directions, `{WEIGHT}`: mean, mm", "1.23", f"{WEIGHT}/ours_mean"),
                Figure("the same: RMS ÷ floor", "–", f"{WEIGHT}/ours_ratio", 2),
                Figure(f"`geometry+motor`, `{WEIGHT}`: mean, mm", "–", f"{WEIGHT}/motor_mean"),
                Figure("floor: mean, mm", "–", "floor_mean"),
                Ordering("ours < POE + network", "–", "ours_mean", "paper_network_mean"),
                Ordering("ours < POE + F·I", "–", "ours_mean", "paper_direct_mean"),
                Ordering("currents in the fit < without", "–", "motor_mean", "neither_mean"),
            ),
        ),
    ),
)
