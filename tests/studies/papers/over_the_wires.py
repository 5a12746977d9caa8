"""The papers' campaigns as a user runs them, over the wires of their simulated cells, for several robots (seeds).

What these say that the computations do not: the robot's way, the time, the table in force: the paper's, and for two of
the papers that of `auto` on the same robot. Run folders stay in `runs/studies/CODE/papers/TAG-SEED` and
`TAG-auto-SEED`.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from cellctl.journal import RunState, fold, read_journal
from procedures.steps.sphere.rows import SphereVerdict
from procedures.steps.tracker.rows import ComparedModelsRow, TrackerVerdict
from tests.helpers.runs import ROOT, finished_run
from tests.studies._runner import ROWS
from tests.studies.papers.statements import Figure, Numbers, Ordering, Paper, Section

FOLDER = ROOT / "procedures" / "papers"
CAMPAIGNS = {
    "sph": "spherical_constraint",
    "cmp": "compensation_methods",
    "krg": "configuration_space_kriging",
    "ann": "point_selection",
}


BY_AUTO = {"krg", "ann"}
"""The papers with a model of their own: their campaigns run again with `model=auto`."""


def study(tag: str, seed: int) -> Numbers:
    """Held-out rows and targets before and after, mm, and the mean of each model that was compared."""
    journal = _journal(tag, tag, seed)
    if tag == "sph":
        return _errors("held_out", journal.recorded(SphereVerdict)[-1])
    found = _of_targets(journal) | _compared(journal)
    if tag in BY_AUTO:
        by_auto = _of_targets(_journal(tag, f"{tag}-auto", seed, "--set", "model=auto"))
        found |= {f"by_auto_{key}": value for key, value in by_auto.items()}
    return found


def _journal(tag: str, name: str, seed: int, *options: str) -> RunState:
    campaign = FOLDER / f"{CAMPAIGNS[tag]}.yaml"
    return fold(read_journal(finished_run(ROWS / "papers" / f"{name}-{seed}", campaign, "--seed", str(seed), *options)))


def _of_targets(journal: RunState) -> Numbers:
    verdict = journal.recorded(TrackerVerdict)[-1]
    return _errors("held_out", verdict.held_out) | _errors("targets", verdict.targets)


def _errors(name: str, figures: Any) -> Numbers:
    return {
        f"{name}_{when}_{what}": getattr(getattr(figures, when), what)
        for when in ("before", "after")
        for what in ("mean", "max")
    }


def _compared(journal: RunState) -> Numbers:
    """Mean and largest error of each model on the held-out poses."""
    row = journal.last(ComparedModelsRow)
    if row is None:
        return {}
    errors = np.array(row.errors)
    found = {f"{model.choice}_mean": float(each.mean()) for model, each in zip(row.models, errors, strict=True)}
    return found | {f"{model.choice}_max": float(each.max()) for model, each in zip(row.models, errors, strict=True)}


def _paper(tag: str, *statements: Figure | Ordering) -> Paper:
    campaign = f"`cellctl run procedures/papers/{CAMPAIGNS[tag]}.yaml`"
    return Paper(
        f"{tag}-run",
        f"Over the wires: {CAMPAIGNS[tag]}",
        f"python -m tests.studies papers --papers {tag}-run",
        partial(study, tag),
        (Section(f"Over the wires: {campaign}", statements),),
    )


def _held_out(mean: tuple[str, str], largest: tuple[str, str], what: str = "held-out poses") -> tuple[Figure, ...]:
    """Figures with the paper's before and after."""
    return (
        Figure(f"{what} before, mean, mm", mean[0], "held_out_before_mean"),
        Figure(f"{what} after, mean, mm", mean[1], "held_out_after_mean"),
        Figure(f"{what} before, largest, mm", largest[0], "held_out_before_max"),
        Figure(f"{what} after, largest, mm", largest[1], "held_out_after_max"),
    )


def _targets(mean: str, largest: str) -> tuple[Figure, ...]:
    """Figures of the targets with the table in force, with the paper's after."""
    return (
        Figure("targets before, mean, mm", "–", "targets_before_mean"),
        Figure("targets with the table in force, mean, mm", mean, "targets_after_mean"),
        Figure("the same: largest, mm", largest, "targets_after_max"),
    )


BY_AUTO_IN_FORCE = (
    Figure("`auto` in force instead, targets, mean, mm", "–", "by_auto_targets_after_mean"),
    Figure("the same: largest, mm", "–", "by_auto_targets_after_max"),
    Ordering(
        "table of `auto` < the paper's, targets, mean", "–", "by_auto_targets_after_mean", "targets_after_mean", 4
    ),
    Ordering("the same, largest", "–", "by_auto_targets_after_max", "targets_after_max", 4),
)


def _model(text: str, key: str, paper: str = "–") -> Figure:
    return Figure(f"{text}, same poses: mean of the held-out ones, mm", paper, f"{key}_mean")


KRG = (
    *_held_out(("4.96", "0.089"), ("–", "0.172")),
    *_targets("–", "0.28"),
    *BY_AUTO_IN_FORCE,
    _model("`auto`", "auto"),
    _model("`geometry`", "geometry"),
    _model("`kriging:weights=equal`", "kriging:weights=equal"),
    _model("`kriging:weights=initial`", "kriging:weights=initial"),
    _model("`kriging:space=position`", "kriging:space=position"),
    _model("`idw`", "idw", "0.502"),
    _model("`perceptron`", "perceptron", "0.212"),
    _model("`perceptron:space=joints`", "perceptron:space=joints"),
    Ordering("kriging < perceptron on position", "0.089 < 0.212", "held_out_after_mean", "perceptron_mean"),
    Ordering("perceptron < inverse distance", "0.212 < 0.502", "perceptron_mean", "idw_mean"),
    Ordering("weights searched < all weights 1", "–", "held_out_after_mean", "kriging:weights=equal_mean"),
    Ordering("perceptron over the joints < over positions", "–", "perceptron:space=joints_mean", "perceptron_mean"),
    Ordering("ours < the paper's kriging", "–", "auto_mean", "held_out_after_mean"),
    Ordering("predicted < after compensation, largest", "0.172 < 0.28", "held_out_after_max", "targets_after_max"),
)
ANN = (
    *_held_out(("5.12", "1.23"), ("–", "–")),
    *_targets("1.23", "–"),
    *BY_AUTO_IN_FORCE,
    _model("`auto`", "auto"),
    _model("`geometry`", "geometry"),
    _model("`poe`", "poe", "1.81"),
    _model("`poe+motor`", "poe+motor"),
    _model("`poe+network`", "poe+network"),
    Ordering("POE, currents and network < POE alone", "1.23 < 1.81", "held_out_after_mean", "poe_mean", 4),
    Ordering("ours < the paper's model", "–", "auto_mean", "held_out_after_mean", 4),
)
PAPERS = {
    "sph-run": _paper("sph", *_held_out(("1.923", "0.383"), ("4.715", "1.153"), "held-out touches")),
    "cmp-run": _paper("cmp", *_held_out(("–", "–"), ("–", "–")), *_targets("0.0539", "–")),
    "krg-run": _paper("krg", *KRG),
    "ann-run": _paper("ann", *ANN),
}
