"""Whether the estimator's own σ is the error that is found: robots drawn from the prior, and from far outside it.

Five tables, about ten minutes on one core; `--only` makes some of them. 1 (`prior`): touches on spheres, positions and
poses of robots drawn from the prior that the fit is told, against the truth and against SciPy's optimum of the same
posterior by finite differences. 2 (`outside`): joint zeros or links far outside the prior. 3 (`orientations`):
positions in one or two orientations of the tool only. 4 (`wrong`): noise or tolerances that are told wrong, and wild
rows. 5 (`lacks`): robots whose joints have errors that the model
lacks, of kinds that σ was tuned on and of others (decision 67). `docs/results/uncertainty.md` explains the
figures; --write replaces those tables between the marks there that were made. Exit code 1: a figure of the first table
lies outside what is promised.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import asdict, fields, replace

import numpy as np

from tests.helpers.honesty import Elsewhere, Honesty, Summary, elsewhere, honesty
from tests.helpers.simulated_setups import MISJUDGED, OUTSIDE, SETUPS, TILTED, UPRIGHT, fixed
from tests.helpers.unmodelled import JUDGING, TUNING
from tests.studies._runner import Row, Study, Table, each

TURNS = {"one": [UPRIGHT], "two, 40° apart": [UPRIGHT, TILTED]}
CASES = {
    "prior": [""],
    "outside": [*OUTSIDE],
    "orientations": [*TURNS],
    "wrong": [*MISJUDGED],
    "lacks": [*TUNING, *JUDGING],
}
"""Table → its cases."""

PLACES = ("place_nees", "found_mm", "stated_mm", "among")
MARK = "uncertainty figures"
FEWER, TUNED, ALONE, OBSERVABLE_SIGMAS = 10, 8, 3, 3
"""The other tables, effects that tuned σ, single effects that judge it, and set-ups in which an instrument sees the
whole error of robots with such effects, take one seed where the first table takes so many."""

FIRST_TUNED = 1000
ALL_EFFECTS = "all three"


def units(asked: Namespace) -> Iterator[Row]:
    """Every seed of every case and set-up of the asked tables."""
    fewer = range(asked.first, asked.first + max(len(asked.seeds) // FEWER, 2))
    for table in asked.only or CASES:
        setups = [""] if table == "orientations" else SETUPS
        for case in CASES[table]:
            for setup in setups:
                seeds = _seeds(table, case, setup, asked.seeds, fewer)
                yield from each(table=[table], case=[case], setup=[setup], seed=seeds)


def _seeds(table: str, case: str, setup: str, seeds: range, fewer: range) -> range:
    if table == "prior":
        return seeds
    if table != "lacks":
        return fewer
    if setup != "SPH":
        seeds = seeds[: max(len(seeds) // OBSERVABLE_SIGMAS, 2)]
    if case == ALL_EFFECTS:
        return seeds
    count = max(len(seeds) // (TUNED if case in TUNING else ALONE), 2)
    first = seeds.start + (FIRST_TUNED if case in TUNING else 0)
    return range(first, first + count)


def measure(table: str, case: str, setup: str, seed: int) -> Row:
    """The figures of one draw."""
    if table == "orientations":
        same, others = elsewhere(*fixed(seed, TURNS[case]))
        return {"at the same": asdict(same), "at others": asdict(others)}
    draw, compared = SETUPS[setup], table in ("prior", "outside")
    if table == "wrong":
        drawn = MISJUDGED[case](draw(seed))
    elif table == "lacks":
        return vars(honesty(draw(seed, besides={**TUNING, **JUDGING}[case](seed)), compared=False, stated=True))
    else:
        drawn = draw(seed, OUTSIDE[case]) if case else draw(seed)
    return vars(honesty(drawn, compared=compared))


def cases(found: list[Row], table: str) -> dict[tuple[str, str], list[Honesty]]:
    """Case and set-up → the figures of its draws, of one table."""
    cases: dict[tuple[str, str], list[Honesty]] = {}
    for row in found:
        if row["table"] == table:
            one = Honesty(**{each.name: row[each.name] for each in fields(Honesty)})
            one = replace(one, **{name: np.array(getattr(one, name)) for name in PLACES})
            cases.setdefault((row["case"], row["setup"]), []).append(one)
    return cases


def as_promised(found: list[Row]) -> bool:
    """Whether all figures of the first table are, if it is made."""
    return all(Summary.of(all_of).as_promised for all_of in cases(found, "prior").values())


def drawn_from_the_prior(rows: list[Row]) -> list[str]:
    """The first table."""
    lines = [
        "| set-up | seeds | NEES per degree of freedom: parameters | predicted points "
        "| truth in the 95 % region: one point | volumetric RMS | all parameters | volumetric RMS (mm) | stated "
        "| relative to SciPy's | largest parameter difference from SciPy's (σ) | clean rows left out, of 1000 "
        "| noise scaled | prior scaled | not converged |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for (_, name), all_of in cases(rows, "prior").items():
        found = Summary.of(all_of)
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
    return lines


def outside_the_prior(rows: list[Row]) -> list[str]:
    """The second table."""
    lines = [
        "| set-up | outside the prior | seeds | NEES per degree of freedom | truth in the 95 % region: volumetric RMS "
        "| volumetric RMS (mm) | stated | relative to SciPy's | found (σ of the prior) | noise scale | prior scale "
        "| not converged |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for (what, name), all_of in cases(rows, "outside").items():
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


def told_wrong(rows: list[Row]) -> list[str]:
    """The fourth table."""
    lines = [
        "| what is wrong | set-up | seeds | NEES per degree of freedom: parameters | predicted points "
        "| truth in the 95 % region: one point | volumetric RMS | volumetric RMS (mm) | stated "
        "| rows left out of 50, mean | noise scale | prior scale |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for (what, name), all_of in cases(rows, "wrong").items():
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


def effects_that_the_model_lacks(rows: list[Row]) -> list[str]:
    """The fifth table."""
    lines = [
        "| set-up | effects | robots | places in their 95 % region | NEES | found (mm) | stated / found "
        "| among the rows | of one robot, 95 % of them | within 0.5 … 2 |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    groups: dict[tuple[str, str], list[Honesty]] = {}
    for (what, name), some in cases(rows, "lacks").items():
        kinds = "four kinds that tuned σ" if what in TUNING else what if what == ALL_EFFECTS else "one of the three"
        groups.setdefault((name, kinds), []).extend(some)
    for (name, what), all_of in sorted(groups.items(), key=lambda group: [*SETUPS].index(group[0][0])):
        ratios = np.array([_stated_over_found([one]) for one in all_of])
        inside = np.mean([one.places_inside for one in all_of])
        cells = (
            f"{100.0 * inside:.1f} %",
            f"{Summary.of(all_of).place_nees:.2f}",
            f"{Summary.of(all_of).rms:.3f}",
            f"{_stated_over_found(all_of):.2f}",
            f"{_stated_over_found(all_of, among=True):.2f}",
            "{:.2f} … {:.2f}".format(*np.quantile(ratios, [0.025, 0.975])),
            f"{100.0 * np.mean((ratios >= 0.5) & (ratios <= 2.0)):.1f} %",
        )
        lines.append(_line(name, what, len(all_of), *cells))
    return lines


def _stated_over_found(all_of: list[Honesty], *, among: bool = False) -> float:
    """Of the RMS over all places of these robots; among: over those among the measured postures."""
    found, stated, near = (np.concatenate([getattr(one, name) for one in all_of]) for name in PLACES[1:])
    which = near > 0.0 if among else np.ones(len(found), bool)
    return float(np.sqrt(np.sum(stated[which] ** 2) / np.sum(found[which] ** 2)))


def fixed_orientations(rows: list[Row]) -> list[str]:
    """The third table."""
    lines = [
        "| orientations of the tool | predicted | seeds | error found, RMS (mm) | stated | NEES per degree of freedom "
        "| point in its 95 % region | not converged |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for what in TURNS:
        for where in ("at the same", "at others"):
            all_of = [Elsewhere(**row[where]) for row in rows if (row["table"], row["case"]) == ("orientations", what)]
            if all_of:
                lines.append(_line(what, where, len(all_of), *_figures(all_of)))
    return lines


def _figures(found: list[Elsewhere]) -> tuple[str, ...]:
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
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


PARTS = {
    "prior": ("Robots drawn from the prior", drawn_from_the_prior),
    "outside": ("Robots from outside the prior", outside_the_prior),
    "orientations": ("One or two orientations only", fixed_orientations),
    "wrong": ("Wrong noise or prior stated", told_wrong),
    "lacks": ("Effects that the model lacks", effects_that_the_model_lacks),
}


def tables(found: list[Row], asked: Namespace) -> Iterator[Table]:
    """All that are made, and the others of the document that is written."""
    made = {title: "\n".join(lines(found)) for part, (title, lines) in PARTS.items() if part in (asked.only or PARTS)}
    written = asked.write.read_text(encoding="utf-8").partition(f"<!-- {MARK}")[2] if asked.write else ""
    for part in written.partition(f"<!-- end of {MARK}")[0].split("### ")[1:]:
        title, _, text = part.partition("\n")
        made.setdefault(title, text.strip())
    texts = (f"### {title}\n\n{made[title]}" for title, _ in PARTS.values() if made.get(title))
    yield Table("\n\n".join(texts), MARK)


ONLY = {"--only": {"choices": PARTS, "action": "append", "help": "one table; may be given again"}}
STUDY = Study(units, measure, tables, seeds=200, first=0, options=ONLY, passed=as_promised, writes=True)
