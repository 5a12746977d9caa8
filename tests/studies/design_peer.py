"""D-optimal poses beside figaroh's, on the same candidates (2 minutes; needs figaroh: `uv run --with figaroh …`).

40 of 200 random poses of a UR10 whose positions are measured, for its geometry, base and tool with their priors.
figaroh solves the relaxed problem, in which a pose may be measured in part (an upper bound of the criterion), and
exchanges poses of a random start (DETMAX; it may take one twice). Random choices: median of 50.
"""

from __future__ import annotations

import random
import warnings
from argparse import Namespace
from collections.abc import Iterator

import numpy as np

from cellctl.formats import RobotFile
from cellctl.formats.design_problem import candidate_rows, design_problem
from cellctl.formats.measurements import measurements
from cellctl.formats.measurements.columns import SIGMA_COLUMNS
from cellctl.planning.design import chosen_rows
from tests.helpers.arms import ROBOTS, Floats
from tests.studies._runner import Row, Study, Table, each

POSES, CHOSEN = 200, 40


def units(asked: Namespace) -> Iterator[Row]:
    """Each seed of the candidates."""
    return each(seed=asked.seeds)


def measure(seed: int) -> Row:
    """The criterion det(information)^(1/P) of each choice, relative to figaroh's bound."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import picos
        from figaroh.optimal.base_optimal_calibration import Detmax, SOCPOptimizer
    information, ours = candidates(seed)

    class Fast(Detmax):  # type: ignore[misc]
        """The same criterion by NumPy: a second instead of hours."""

        def get_critD(self, some: list[int]) -> float:  # noqa: N802 - figaroh's name
            return criterion(information[some].sum(axis=0))

    random.seed(seed)
    exchanged = Fast(dict(enumerate(information)), CHOSEN).main_algo()[-1]
    pool = {index: picos.Constant(f"X{index}", CHOSEN * one) for index, one in enumerate(information)}
    shares, _ = SOCPOptimizer(pool, {"NbSample": POSES}).solve()
    bound = criterion(CHOSEN * np.einsum("m,mij->ij", np.array(shares), information))
    draws = [np.random.default_rng([seed, draw]).permutation(POSES)[:CHOSEN] for draw in range(50)]
    at_random = float(np.median([criterion(information[some].sum(axis=0)) for some in draws]))
    own = criterion(information[list(ours)].sum(axis=0))
    return {"own": own / bound, "figaroh": exchanged / bound, "random": at_random / bound}


def candidates(seed: int) -> tuple[Floats, tuple[int, ...]]:
    """Information (200, P, P) of each pose, in units of the priors, and the poses that cellctl chooses.

    A fortieth of the priors' information is in each: so any 40 have the posterior's.
    """
    robot = RobotFile.load(ROBOTS / "ur10.yaml")
    low, high = np.clip(robot.limits(), -170.0, 170.0).T
    readings = np.random.default_rng(seed).uniform(low, high, (POSES, len(low)))
    places = robot.chain().forward(robot.joint_map().model(readings))[:, :3, 3]
    sigma = float(np.hypot(0.02, robot.repeatability / np.sqrt(3.0)))
    columns = dict(zip("XYZ", places.T.tolist(), strict=True)) | dict.fromkeys(SIGMA_COLUMNS, [sigma] * POSES)
    problem = design_problem(measurements(robot, candidate_rows(readings, columns), model="geometry").task)
    asked = problem.places(robot.joint_map().model(readings))
    chosen = chosen_rows(problem.covariance, problem.candidates, asked, CHOSEN, "D")
    free = np.diag(problem.covariance) > 0.0
    rows = problem.candidates[:, :, free] * np.sqrt(np.diag(problem.covariance)[free])
    information = np.einsum("mki,mkj->mij", rows, rows) + np.eye(rows.shape[2]) / CHOSEN
    # ratios of determinants stay, and no number is lost: σ of the base's prior is 1 m
    scale = np.diag(information.sum(axis=0)) ** -0.5
    return information * scale[:, None] * scale, chosen.rows


def criterion(information: Floats) -> float:
    """det^(1/P)."""
    sign, log_determinant = np.linalg.slogdet(information)
    return float(np.exp(log_determinant / len(information))) if sign > 0 else 0.0


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """Range over the seeds."""
    lines = ["| choice | share of figaroh's bound |", "|---|---|"]
    for name in ("own", "figaroh", "random"):
        shares = [row[name] for row in found]
        lines.append(f"| {name} | {min(shares):.3f} … {max(shares):.3f} |")
    yield Table("\n".join(lines), title="D-optimal poses")


STUDY = Study(units, measure, tables, seeds=5, first=0)
