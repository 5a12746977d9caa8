"""Whether the stated σ is the error found, of robots that tuned nothing: a flexible sphere cell and real robots.

Two tables. *Other robots*: touches of the flexible sphere cell, computed without wires (and, by `--only tuning`, of
robots with `unmodelled.FLEXIBLE`, which tuned σ: decision 76), at 256 places of the measured region without common
rigid motions; held-out rows of the UR10, and of visits in sockets by iiwa and Panda. *CV+*: held-out rows of simulated
robots within their bound without a distribution. The public data are not in this repository.
`docs/results/uncertainty.md` explains the figures; --write replaces those that were made.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from contextlib import redirect_stdout
from json import loads
from pathlib import Path
from sys import stderr
from tempfile import TemporaryDirectory

import numpy as np

from cellctl.calibration import Split, fit
from cellctl.kinematics import Floats
from cellctl.kinematics.low_discrepancy import spread_over
from tests.helpers.honesty import rigid_motions, task_of
from tests.helpers.real_data import cellctl, with_ball
from tests.helpers.simulated_setups import ROWS, SETUPS
from tests.helpers.touched_robots import touched
from tests.helpers.unmodelled import FLEXIBLE, JUDGING
from tests.studies._runner import Row, Study, Table, each
from tests.studies.outside_the_joints import figures, measured

PLACES = 256
UR10 = {"40 poses": (40, 6), "100 poses": (100, 6), "200 poses": (200, 4), "800 poses": (800, 2)}
"""Rows of the fit and draws."""
PREDICTED = 1500
SOCKETS = {"five folds": (), "a place left out": ("--by", "session")}
VISITED = {"iiwa": "iiwa14", "Panda": "panda"}
FLEXIBLE_CELL = "flexible sphere cell"
BOUNDED, HELD_OUT = 15, 10
"""Robots of each set-up, and rows of each, that judge the bound without a distribution."""
MARK, BOUND_MARK = "other robots figures", "bound figures"


def units(asked: Namespace) -> Iterator[Row]:
    """Every robot of the asked tables."""
    only = asked.only or ["cell", "real", "bound"]
    if "tuning" in only:
        yield from each(robot=["tuning"], case=[*FLEXIBLE], seed=range(1000, 1000 + len(asked.seeds)))
    if "cell" in only:
        yield from each(robot=[FLEXIBLE_CELL], case=["its own errors"], seed=asked.seeds)
    if "real" in only:
        for case, (_, draws) in UR10.items():
            yield from each(robot=["UR10"], case=[case], seed=range(draws))
        yield from each(robot=[*VISITED], case=[*SOCKETS], seed=[0])
    if "bound" in only:
        yield from each(robot=["bound"], case=[*SETUPS], seed=range(BOUNDED))


def measure(robot: str, case: str, seed: int) -> Row:
    """found and stated, mm (RMS), and the share inside its 95 % region."""
    if robot == "bound":
        return bounded(case, seed)
    if robot == "UR10":
        count = UR10[case][0]
        order = np.random.default_rng([count, seed]).permutation(len(measured()[0]))[: count + PREDICTED]
        q, xyz = (part[order] for part in measured())
        one = figures(q, xyz, count)
        return {**{name: one[name] for name in ("found", "stated", "sigma_ok")}, "inside": one["coverage"]}
    if robot in VISITED:
        return visited(VISITED[robot], SOCKETS[case])
    return touching(case, seed)


def touching(case: str, seed: int) -> Row:
    """Of a robot of the flexible sphere cell, or with errors of a kind of `FLEXIBLE`."""
    asked = touched(seed, FLEXIBLE[case](seed) if case in FLEXIBLE else None)
    result = asked.fitted()
    best, region = result.identification.identified, result.region
    model, count = best.state.model, best.unknowns.robot
    q = spread_over(region.lower, region.upper, PLACES, scramble=False)
    points = model.tcp(q)
    kept = rigid_motions(points)
    error = (points - asked.true(q)).ravel()
    error = (error - kept @ (kept.T @ error)).reshape(-1, 3)
    besides = np.sqrt(region.sigma(q) ** 2 / 3.0 + model.open_variance(q))
    columns = model.jacobian(q)[:, :3].reshape(len(kept), -1) @ np.linalg.cholesky(
        best.covariance[:count, :count] + 1e-14 * np.eye(count)
    )
    spread = np.hstack([columns, np.diag(np.repeat(besides, 3))])
    spread = (region.model_error_scale * (spread - kept @ (kept.T @ spread))).reshape(PLACES, 3, -1)
    covariance = spread @ np.swapaxes(spread, 1, 2)
    nees = np.einsum("nk,nk->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    return {
        "found": float(np.sqrt(np.mean(np.sum(error**2, axis=1)))),
        "stated": float(np.sqrt(np.mean(np.trace(covariance, axis1=1, axis2=2)))),
        "inside": float(np.mean(nees <= 3.0 * region.radius_95**2)),
        "sigma_ok": result.sigma_ok,
    }


def visited(robot: str, split: tuple[str, ...]) -> Row:
    """Of visits in sockets 50 mm apart."""
    with TemporaryDirectory() as folder, redirect_stdout(stderr):
        file, report = with_ball(robot, Path(folder)), Path(folder) / "fit.json"
        cellctl("fit", file, Path(folder) / f"{robot}.csv", "--spacing", "0,1=50±0.05", "--json", report, *split)
        one = loads(report.read_text(encoding="utf-8"))
    return {
        "found": one["test"]["rms"],
        "stated": one["predicted_test_rms"],
        "inside": one["coverage_95"],
        "sigma_ok": one["sigma_ok"],
    }


def bounded(setup: str, seed: int) -> Row:
    """Held-out rows with a bound by CV+, and those within it, of a robot with all effects that judge σ."""
    task = task_of(SETUPS[setup](seed, besides=JUDGING["all three"](seed)))
    result = fit(task, Split.by_column(np.arange(ROWS) >= ROWS - HELD_OUT))
    bound = result.distribution_free.at(task.rows.pick(np.arange(ROWS - HELD_OUT, ROWS)).only)
    known = np.isfinite(bound)
    return {"known": int(known.sum()), "within": int(np.sum(result.test_errors[known] <= bound[known]))}


def others(rows: list[Row]) -> list[str]:
    """The table of other robots."""
    lines = [
        "| robot | robots or draws | in the 95 % region | found (mm) | stated / found | within 0.5 … 2 | `sigma_ok` |",
        "|---|---|---|---|---|---|---|",
    ]
    for robot, case in dict.fromkeys((row["robot"], row["case"]) for row in rows if row["robot"] != "bound"):
        mine = [row for row in rows if (row["robot"], row["case"]) == (robot, case)]
        found, stated, inside = (np.array([row[name] for row in mine]) for name in ("found", "stated", "inside"))
        ratios = stated / found
        said = [row["sigma_ok"] for row in mine]
        cells = (
            f"{robot}, {case}",
            f"{len(mine)}",
            f"{100.0 * inside.mean():.1f} %{_range(100.0 * inside, 0)}",
            f"{np.sqrt(np.mean(found**2)):.3f}",
            f"{np.sqrt(np.sum(stated**2) / np.sum(found**2)):.2f}{_range(ratios, 2)}",
            f"{100.0 * np.mean((ratios >= 0.5) & (ratios <= 2.0)):.0f} %",
            ", ".join(f"{said.count(is_ok)} {name}" for is_ok, name in SAID.items() if is_ok in said),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _range(values: Floats, digits: int) -> str:
    return f" ({values.min():.{digits}f} … {values.max():.{digits}f})" if len(values) > 1 else ""


SAID = {True: "true", False: "false", None: "not known"}


def bounds(rows: list[Row]) -> list[str]:
    """The table of the bound without a distribution."""
    lines = ["| set-up | robots | rows with a bound | within it |", "|---|---|---|---|"]
    for setup in SETUPS:
        mine = [row for row in rows if (row["robot"], row["case"]) == ("bound", setup)]
        if mine:
            known = sum(row["known"] for row in mine)
            share = 100.0 * sum(row["within"] for row in mine) / known
            lines.append(f"| {setup} | {len(mine)} | {100.0 * known / (HELD_OUT * len(mine)):.0f} % | {share:.1f} % |")
    return lines


def tables(rows: list[Row], asked: Namespace) -> Iterator[Table]:
    """Those with rows."""
    del asked
    if any(row["robot"] != "bound" for row in rows):
        yield Table("\n".join(others(rows)), MARK)
    if any(row["robot"] == "bound" for row in rows):
        yield Table("\n".join(bounds(rows)), BOUND_MARK)


ONLY = {"--only": {"choices": ("tuning", "cell", "real", "bound"), "action": "append", "help": "may be given again"}}
STUDY = Study(units, measure, tables, seeds=60, first=1, options=ONLY, writes=True)
