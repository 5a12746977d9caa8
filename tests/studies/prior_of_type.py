"""What a prior of the type saves: rows that give the same error, and whether σ stays right; one robot out at a time.

Twenty robots of one type have a run of 50 rows each. Each is then measured again with few rows, and fitted with and
without the prior of the nineteen others. `common`: the type's mean is half a tolerance off nominal in every parameter
of the arm, the robots' spread is a quarter of it; `none`: no mean, the spread is the tolerance; `other robot`: the
prior is of a `common` type, the robot of another one. A seed is a type. `docs/results/priors-and-agreement.md`
has the figures; --write replaces them.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator

import numpy as np

from cellctl.calibration.distributions import chi2_ppf
from cellctl.calibration.prediction.predict import shape_columns
from cellctl.calibration.problem.registration import rigid_fit
from cellctl.calibration.random_effects import RandomEffects, of_rows_alone
from cellctl.calibration.rows.type_rows import TypePrior
from tests.helpers.honesty import Fitted, fitted
from tests.helpers.own_model import Floats, OwnTouches
from tests.helpers.simulated_setups import PRIOR, SETUPS, Draw
from tests.studies._runner import Row, Study, Table, each

ROBOTS = 20
COUNTS = {"positions": (8, 12, 16, 25, 50), "SPH": (18, 25, 50)}
CASES = ("common", "none", "other robot")
OFF, SPREAD = 0.5, 0.25
"""Of the type's mean and of its robots, in tolerances."""
LIMIT = float(chi2_ppf(0.95, 3))


def errors_of(seed: int, robot: int, case: str, names: tuple[str, ...]) -> dict[str, float]:
    """The errors of a robot of a type, by parameter of the arm; mm, rad."""
    tolerances = np.array([PRIOR.sigma(name, ()) for name in names])
    own = np.random.default_rng([seed, robot, 23]).normal(size=len(names))
    if case == "none":
        return dict(zip(names, (own * tolerances).tolist(), strict=True))
    mean = OFF * np.random.default_rng([seed, 29]).choice([-1.0, 1.0], len(names))
    return dict(zip(names, ((mean + SPREAD * own) * tolerances).tolist(), strict=True))


def measured(setup: str, count: int, seed: int, robot: int, case: str, *, again: bool) -> Draw:
    """Rows of a robot: of its run, or `again`, from a place of their own."""
    draw = SETUPS[setup]
    names = draw(1).nominal.link_names
    return draw(1000 * seed + 2 * robot + again, errors=errors_of(seed, robot, case, names), count=count)


def prior_of(fits: list[Fitted], names: tuple[str, ...]) -> tuple[TypePrior, RandomEffects]:
    """The prior of these robots' type."""
    tolerances = np.array([PRIOR.sigma(name, ()) for name in names])
    rows = [of_rows_alone(*_of_the_arm(fit, names), tolerances) for fit in fits]
    found = RandomEffects.of(*(np.stack(part) for part in zip(*rows, strict=True)))
    covariance = found.predicted * np.outer(tolerances, tolerances)
    return TypePrior(names, found.mean * tolerances, covariance), found


def _of_the_arm(fit: Fitted, names: tuple[str, ...]) -> tuple[Floats, Floats, Floats]:
    """Values, covariance and prior σ of the parameters `names`."""
    best = fit.identification.identified
    at = [best.unknowns.names.index(name) for name in names]
    return best.state.model.deviations[at], best.covariance[np.ix_(at, at)], best.unknowns.sigma[at]


def judged(draw: Draw, prior: TypePrior | None) -> tuple[float, float, float]:
    """Errors at the asked postures, mm (RMS), stated σ, and the share of them in their 95 % region; of touches without
    the best rigid motion.
    """
    found = fitted(draw, prior)
    truth, (places, sigma) = draw.truth.points(draw.asked), found.predicted(draw.asked)
    away, columns, covariance = places - truth, found.columns(draw.asked), found.covariance
    if isinstance(draw.rows, OwnTouches):  # touches do not show where the robot stands
        best = found.identification.identified
        covariance = best.covariance[: best.unknowns.robot, : best.unknowns.robot]
        columns = shape_columns(best.state.model, draw.asked).reshape(len(truth), 3, -1)
        pose = rigid_fit(places, truth)
        away = places @ pose[:3, :3].T + pose[:3, 3] - truth
        sigma = np.sqrt(np.einsum("nip,pq,niq->n", columns, covariance, columns))
    spread = columns @ covariance @ np.swapaxes(columns, 1, 2) + 1e-12 * np.eye(3)
    squares = np.einsum("ni,ni->n", away, np.linalg.solve(spread, away[..., None])[..., 0])
    figures = np.sqrt(np.mean(np.sum(away**2, axis=1))), np.sqrt(np.mean(sigma**2)), np.mean(squares <= LIMIT)
    rms, stated, inside = (round(float(each), 5) for each in figures)
    return rms, stated, inside


def units(asked: Namespace) -> Iterator[Row]:
    """A type of each case and set-up."""
    for setup, seeds in (("positions", asked.seeds), ("SPH", asked.seeds[:2])):  # a type of touches takes minutes
        yield from each(setup=[setup], case=CASES, seed=seeds)


def measure(setup: str, case: str, seed: int) -> Row:
    """Each robot left out in turn: with and without the prior, at each number of rows."""
    of_type = "common" if case == "other robot" else case
    fits = [fitted(measured(setup, 50, seed, robot, of_type, again=False)) for robot in range(ROBOTS)]
    names = SETUPS[setup](1).nominal.link_names
    found: dict[str, dict[str, list[tuple[float, float, float]]]] = {}
    supported = 0
    for robot in range(ROBOTS):
        prior, effects = prior_of(fits[:robot] + fits[robot + 1 :], names)
        supported += effects.supported
        for count in COUNTS[setup]:
            draw = measured(setup, count, seed, robot, "none" if case == "other robot" else case, again=True)
            of_count = found.setdefault(str(count), {"with": [], "without": []})
            of_count["with"].append(judged(draw, prior))
            of_count["without"].append(judged(draw, None))
    return {"robots": found, "supported": supported}


def tables(found: list[Row], asked: Namespace) -> Iterator[Table]:
    """Errors and coverage by number of rows, for each case."""
    lines = [
        "| rows | type | number | error without (mm, RMS) | with | ratio of medians | stated/found without | with "
        "| places in the 95 % region without | with |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for setup, counts in COUNTS.items():
        for case in CASES:
            mine = [row for row in found if (row["setup"], row["case"]) == (setup, case)]
            for count in counts if mine else ():
                of_count = [row["robots"][str(count)] for row in mine]
                without, within = (
                    _pooled([one for each in of_count for one in each[which]]) for which in ("without", "with")
                )
                cells = (
                    f"{without['rms']:.3f}",
                    f"{within['rms']:.3f}",
                    f"{within['median'] / without['median']:.2f}",
                    *(f"{each['stated'] / each['rms']:.2f}" for each in (without, within)),
                    *(f"{100.0 * each['inside']:.1f} %" for each in (without, within)),
                )
                lines.append("| " + " | ".join([setup, case, str(count), *cells]) + " |")
    yield Table("\n".join(lines), "priors of types")


def _pooled(robots: list[tuple[float, float, float]]) -> dict[str, float]:
    errors, stated, inside = np.array(robots).T
    return {
        "rms": float(np.sqrt(np.mean(errors**2))),
        "median": float(np.median(errors)),
        "stated": float(np.sqrt(np.mean(stated**2))),
        "inside": float(np.mean(inside)),
    }


STUDY = Study(units, measure, tables, seeds=3, writes=True)
