"""Whether the estimator's own σ is the error that is found: robots drawn from the prior, and from far outside it.

    uv run python tests/studies/honest_uncertainty.py [--seeds 200] [--first 0] [--only lacks]
                                                      [--write docs/results/uncertainty.md]

Five tables, about ten minutes on one core; `--only` makes some of them. 1 (`prior`): touches on spheres, positions and
poses of robots drawn from the prior that the fit is told, against the truth and against SciPy's optimum of the same
posterior by finite differences. 2 (`outside`): joint zeros or links far outside the prior. 3 (`orientations`):
positions in one or two orientations of the tool only. 4 (`wrong`): noise or tolerances that are told wrong, and wild
rows. 5 (`lacks`): robots whose joints have errors that the model lacks. `docs/results/uncertainty.md` explains the
figures; --write replaces those tables between the marks there that were made. Exit code 1: a figure of the first table
lies outside what is promised.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from fixed_orientations import TILTED, UPRIGHT, fixed
from honesty import Elsewhere, Honesty, Summary, elsewhere, honesty
from misjudged import MISJUDGED
from own_effects import JointErrors
from simulated_setups import OUTSIDE, SETUPS

BEGIN, END = "<!-- uncertainty figures:", "<!-- end of uncertainty figures -->"
FEWER = 10
"""The other tables take one seed where the first takes this many."""


def drawn_from_the_prior(seeds: range) -> tuple[list[str], bool]:
    """The first table, and whether all its figures are as promised."""
    lines = [
        "| set-up | seeds | NEES per degree of freedom: parameters | predicted points "
        "| truth in the 95 % region: one point | volumetric RMS | all parameters | volumetric RMS (mm) | stated "
        "| relative to SciPy's | largest parameter difference from SciPy's (σ) | clean rows left out, of 1000 "
        "| noise scaled | prior scaled | not converged |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    kept = True
    for name, draw in SETUPS.items():
        found = Summary.of([honesty(draw(seed)) for seed in seeds])
        kept = kept and found.as_promised
        cells = (
            f"{found.nees:.3f}",
            f"{found.place_nees:.3f}",
            *(f"{100.0 * share:.1f} %" for share in (found.place_coverage, found.volume_coverage, found.coverage)),
            f"{found.rms:.4f}",
            f"{found.said:.4f}",
            f"{found.ratio:.4f}",
            f"{found.off_scipy:.3f}",
            f"{found.left_out_per_1000:.2f}",
            str(found.grown),
            str(found.prior_scale),
            str(found.unconverged),
        )
        lines.append(_line(name, found.draws, *cells))
    return lines, kept


def outside_the_prior(seeds: range) -> list[str]:
    """The second table."""
    lines = [
        "| set-up | outside the prior | seeds | NEES per degree of freedom | truth in the 95 % region: volumetric RMS "
        "| volumetric RMS (mm) | stated | relative to SciPy's | found (σ of the prior) | noise scale | prior scale "
        "| not converged |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for (what, errors), (name, draw) in ((case, setup) for case in OUTSIDE.items() for setup in SETUPS.items()):
        all_of = [honesty(draw(seed, errors)) for seed in seeds]
        found = Summary.of(all_of)
        cells = (
            f"{found.nees:.2f}",
            f"{100.0 * found.volume_coverage:.0f} %",
            f"{found.rms:.3f}",
            f"{found.said:.3f}",
            f"{found.ratio:.3f}",
            _span(one.strangest for one in all_of),
            _span(one.growth for one in all_of),
            _loosened(all_of),
            str(found.unconverged),
        )
        lines.append(_line(name, what, found.draws, *cells))
    return lines


def told_wrong(seeds: range) -> list[str]:
    """The fourth table."""
    lines = [
        "| what is wrong | set-up | seeds | NEES per degree of freedom: parameters | predicted points "
        "| truth in the 95 % region: one point | volumetric RMS | volumetric RMS (mm) | stated "
        "| rows left out of 50, mean | noise scale | prior scale |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for (what, changed), (name, draw) in ((case, setup) for case in MISJUDGED.items() for setup in SETUPS.items()):
        all_of = [honesty(changed(draw(seed)), compared=False) for seed in seeds]
        found = Summary.of(all_of)
        cells = (
            f"{found.nees:.2f}",
            f"{found.place_nees:.2f}",
            *(f"{100.0 * share:.0f} %" for share in (found.place_coverage, found.volume_coverage)),
            f"{found.rms:.3f}",
            f"{found.said:.3f}",
            f"{50.0 * found.left_out_per_1000 / 1000.0:.2f}",
            _span(one.growth for one in all_of),
            _loosened(all_of),
        )
        lines.append(_line(what, name, found.draws, *cells))
    return lines


def effects_that_the_model_lacks(seeds: range) -> list[str]:
    """The fifth table."""
    lines = [
        "| set-up | seeds | NEES per degree of freedom, predicted points | truth in the 95 % region: one point "
        "| volumetric RMS | volumetric RMS (mm) | stated | found / stated | rows left out of 50, mean | noise scale "
        "| prior scale | not converged |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, draw in SETUPS.items():
        all_of = [honesty(draw(seed, besides=JointErrors.drawn(seed)), compared=False) for seed in seeds]
        found = Summary.of(all_of)
        cells = (
            f"{found.place_nees:.2f}",
            *(f"{100.0 * share:.1f} %" for share in (found.place_coverage, found.volume_coverage)),
            f"{found.rms:.4f}",
            f"{found.said:.4f}",
            f"{found.rms / found.said:.2f}",
            f"{50.0 * found.left_out_per_1000 / 1000.0:.2f}",
            _span(one.growth for one in all_of),
            _loosened(all_of),
            str(found.unconverged),
        )
        lines.append(_line(name, found.draws, *cells))
    return lines


def fixed_orientations(seeds: range) -> list[str]:
    """The third table."""
    lines = [
        "| orientations of the tool | predicted | seeds | error found, RMS (mm) | stated | NEES per degree of freedom "
        "| point in its 95 % region | not converged |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for what, turns in {"one": [UPRIGHT], "two, 40° apart": [UPRIGHT, TILTED]}.items():
        pairs = [elsewhere(*fixed(seed, turns)) for seed in seeds]
        for where, all_of in zip(("at the same", "at others"), zip(*pairs, strict=True), strict=True):
            lines.append(_line(what, where, len(all_of), *_figures(all_of)))
    return lines


def _figures(all_of: Iterable[Elsewhere]) -> tuple[str, ...]:
    found = list(all_of)
    rms, said = (float(np.sqrt(np.mean([getattr(one, which) ** 2 for one in found]))) for which in ("rms", "said_rms"))
    nees, inside = np.mean([one.nees for one in found]), np.mean([one.inside for one in found])
    apart = sum(not one.converged for one in found)
    return f"{rms:.3f}", f"{said:.3f}", f"{nees:.2f}", f"{100.0 * inside:.0f} %", str(apart)


def _loosened(all_of: list[Honesty]) -> str:
    groups = dict.fromkeys(group for one in all_of for group in one.prior_scale)
    return ", ".join(f"{group} {_span(one.prior_scale.get(group, 1.0) for one in all_of)}" for group in groups) or "–"


def _span(values: Iterable[float]) -> str:
    found = sorted(values)
    return f"{found[0]:.1f}" if found[0] == found[-1] else f"{found[0]:.1f} … {found[-1]:.1f}"


def _line(*cells: object) -> str:
    line = "| " + " | ".join(str(cell) for cell in cells) + " |"
    print(line, file=sys.stderr, flush=True)
    return line


def write_into(document: Path, made: Mapping[str, str]) -> None:
    """Replace the tables between the marks that were `made`, by title; the others stay."""
    before, begin, rest = document.read_text(encoding="utf-8").partition(BEGIN)
    mark, _, _ = rest.partition("\n")
    tables, end, after = rest.partition(END)
    if not (begin and end):
        raise RuntimeError(f"{document} has no place for the figures")
    known = {part.partition("\n")[0]: part.partition("\n")[2].strip() for part in tables.split("### ")[1:]}
    text = _text({title: made.get(title, known.get(title, "")) for title in PARTS.values()})
    document.write_text(f"{before}{begin}{mark}\n{text}\n{end}{after}", encoding="utf-8")


def _text(tables: Mapping[str, str]) -> str:
    return "\n\n".join(f"### {title}\n\n{table}" for title, table in tables.items() if table)


PARTS = {
    "prior": "Robots drawn from the prior",
    "outside": "Robots from outside the prior",
    "orientations": "One or two orientations only",
    "wrong": "Wrong noise or prior stated",
    "lacks": "Effects that the model lacks",
}
OF_FEWER = {"outside": outside_the_prior, "orientations": fixed_orientations, "wrong": told_wrong}


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Whether the estimator's own σ is the error that is found.")
    parser.add_argument("--seeds", type=int, default=200, help="of `prior` and `lacks`; the others take a tenth")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", choices=PARTS, action="append", help="one table; may be given again")
    parser.add_argument("--write", type=Path)
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    fewer = range(asked.first, asked.first + max(asked.seeds // FEWER, 2))
    made, kept = {}, True
    for part in asked.only or PARTS:
        if part == "prior":
            lines, kept = drawn_from_the_prior(seeds)
        else:
            lines = effects_that_the_model_lacks(seeds) if part == "lacks" else OF_FEWER[part](fewer)
        made[PARTS[part]] = "\n".join(lines)
    print(_text(made))
    if asked.write:
        write_into(asked.write, made)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
