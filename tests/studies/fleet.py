"""Drift charts of a fleet over five years: false alarms, what is found and when, and wrong advice to calibrate.

*Charts*: 300 robots of a stated truth, in five years of checks. The parameters of a check are drawn: the estimates of
a fit with covariance C after and P before its rows have C − C P⁻¹ C about (1 − C P⁻¹) of the truth; C and P are of one
shipped campaign (50 touches on three spheres). The charts are those of `cellctl fleet`. *Plant*: such robots in an
index, and what the fleet says of them at the end of each year. *Campaigns*: whole campaigns of one robot (planned,
touched in the simulated world without wires, identified), unchanged and with a moved zero of joint 3: have their
estimates that distribution? *Wires*: the same by `cellctl run`. `docs/results/fleet.md` explains the figures.
"""

from __future__ import annotations

import json
import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from cellctl.kinematics import Floats
from cellctl.operations.fleet import fleet
from cellctl.operations.fleet_charts import DETERMINED, ChartedRobot, judge_all
from cellctl.run_index import IndexedParameter, IndexedRun, opened_index
from tests.helpers.runs import ROOT, SELFCAL, quick_cell
from tests.helpers.touch_campaign import SPHERES, TouchCampaign
from tests.studies._runner import Row, Study, Table, each

ROBOTS, ROBOTS_DAILY, YEARS = 300, 100, 5
RATES = {"monthly": 12, "weekly": 52, "daily": 365}
SEED, TOUCHES, HELD_OUT = 7, 50, 30
STEPS_DEG = (0.0025, 0.005, 0.01, 0.02, 0.04)
"""A collision: the zero of joint 3 jumps by this after two years."""
WEAR_DEG = (0.001, 0.0025, 0.005, 0.02)
"""Of the zero of joint 3 in a year."""
SEASON_K, EXPANSION = 8.0, 11.6e-6
"""Amplitude of the hall's temperature over a year, and the steel's thermal expansion in 1/K."""
LINKS_MM = {"a2": 600.0, "d4": 620.0}
"""Links that grow with it, about those of a KR5 R1400."""
MOVED = "theta3"
CAMPAIGN_STEP_DEG = 0.05
WIRED_TOUCHES = (50, 53, 56, 59)
"""Touches of the campaigns by wires: the simulated scatter is that of the place, so that others need other touches."""
PLANT = {
    "unchanged": (240, "unchanged", 0.0),
    "collision of 0.08°": (15, "collision", 0.08),
    "wear of 0.02° a year": (15, "wear", 0.02),
    "season": (30, "season", 0.0),
}
"""Truth → number of robots, case and size. Those with a season are all that are in one hall."""
FIRST = datetime(2026, 1, 5, 6)


class Fit(NamedTuple):
    """Of one campaign: names and σ (P,) of the charted parameters; gain (P, n): their change for one of all n
    parameters, spread (P, P): a root of the covariance of their estimates.
    """

    names: tuple[str, ...]
    all: tuple[str, ...]
    units: tuple[str, ...]
    sigmas: Floats
    gain: Floats
    spread: Floats


@lru_cache(1)
def fitted() -> Fit:
    """Of the shipped campaign."""
    model = campaign(0, 0.0)
    free = [place for place, each in enumerate(model["parameters"]) if each["prior_sigma"] > 0.0]
    parameters = [model["parameters"][place] for place in free]
    after = np.array(model["covariance"])[np.ix_(free, free)]
    before = np.array([each["prior_sigma"] ** 2 for each in parameters])
    sampled = after - (after / before) @ after
    chosen = [place for place, each in enumerate(parameters) if charted(each)]
    values, vectors = np.linalg.eigh(sampled[np.ix_(chosen, chosen)])
    return Fit(
        tuple(parameters[place]["name"] for place in chosen),
        tuple(each["name"] for each in parameters),
        tuple(parameters[place]["unit"] for place in chosen),
        np.sqrt(np.diag(after)[chosen]),
        (np.eye(len(free)) - after / before)[chosen],
        vectors * np.sqrt(np.maximum(values, 0.0)),
    )


def charted(parameter: dict[str, Any]) -> bool:
    """Whether the fleet charts it."""
    determined = 0.0 < parameter["sigma"] < DETERMINED * parameter["prior_sigma"]
    return bool(determined and parameter["name"] not in {f"tool_{axis}" for axis in "xyzabc"})


def campaign(check: int, shift_deg: float) -> dict[str, Any]:
    """The model of a whole campaign of the robot `SEED`, the zero of its joint 3 moved."""
    with TemporaryDirectory() as folder:
        made = Moved(check, shift_deg, Path(folder))
        plan = made.do("sphere.plan", fit=TOUCHES, held_out=HELD_OUT, spheres=", ".join(SPHERES), reference_every=20)
        made.touch(plan.touches)
        made.do("sphere.identify")
        found: dict[str, Any] = json.loads((Path(folder) / "model.json").read_text(encoding="utf-8"))
        return found


class Moved(TouchCampaign):
    """A campaign with touches of its own."""

    def __init__(self, check: int, shift_deg: float, folder: Path) -> None:
        super().__init__(SEED, folder)
        self.context.seed = 1000 + check  # type: ignore[attr-defined]
        self._shift_deg = shift_deg

    def _contact(self, plan: Any) -> tuple[float, ...]:
        found = list(super()._contact(plan))
        found[2] = round(found[2] - self._shift_deg, 6)  # a reading is less than the angle by what the zero moved
        return tuple(found)


def by_wires(touches: int) -> dict[str, Any]:
    """The model of `cellctl run sphere_selfcal` with so many touches."""
    with TemporaryDirectory() as folder:
        cell = quick_cell(Path(folder))
        words = ["run", SELFCAL, "--cell", cell, "--runs", folder, "--seed", SEED, "--set", f"touches_fit={touches}"]
        command = [sys.executable, "-m", "cellctl", *map(str, words)]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=1800)
        (file,) = Path(folder).glob("*/model.json")
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found


def truth(case: str, size: float, runs: int, rate: float) -> Floats:
    """Change (runs, n) of all parameters from the first run."""
    about, result = fitted(), np.zeros((runs, len(fitted().all)))
    years = np.arange(runs) / rate
    if case == "collision":
        result[:, about.all.index(MOVED)] = np.deg2rad(size) * (years >= 2.0)
    elif case == "wear":
        result[:, about.all.index(MOVED)] = np.deg2rad(size) * years
    elif case == "season":
        warmer = SEASON_K * (np.sin(2.0 * np.pi * years) - np.sin(0.0))
        for name, length in LINKS_MM.items():
            result[:, about.all.index(name)] = length * EXPANSION * warmer
    return result


def drawn(rng: np.random.Generator, robots: int, change: Floats) -> Floats:
    """Estimates (robots, runs, P) of robots with this change (runs, n)."""
    about = fitted()
    noise = rng.normal(size=(robots, len(change), len(about.names)))
    return np.asarray(change @ about.gain.T + noise @ about.spread.T)


def dates(runs: int, rate: float) -> list[str]:
    """When the runs were."""
    each = timedelta(days=365.25 / rate)
    return [(FIRST + number * each).strftime("%Y-%m-%dT%H:%M:%SZ") for number in range(runs)]


def of_charts(case: str, size: float, rate: float, seed: int) -> Row:
    """Alarms of 300 robots in five years: how many robots had so many; runs from the change to the first one after."""
    about, runs = fitted(), round(YEARS * rate) + 1
    rng, began = np.random.default_rng([seed, int(1e6 * size), int(rate)]), dates(runs, rate)
    values = drawn(rng, ROBOTS if rate < 100 else ROBOTS_DAILY, truth(case, size, runs, rate))
    stated = about.sigmas / (2.0 if case == "σ stated half" else 1.0)
    rows = [SimpleNamespace(began=each) for each in began]
    robots = [
        ChartedRobot(f"{number}", rows, about.names, about.units, own, np.tile(stated, (runs, 1)), runs)
        for number, own in enumerate(values)
    ]
    small = judge_all(robots, {})
    beyond = np.array([np.abs(np.nan_to_num(robot.charts.ratio)) > robot.limit for robot in robots])
    raised = beyond[:, 1:] & ~beyond[:, :-1]
    change = round(2.0 * rate) if case == "collision" else 0
    after = beyond[:, change:].any(axis=2)
    delays = np.where(after.any(axis=1), np.argmax(after, axis=1) + 1, -1)
    return {
        "alarms": np.bincount(raised[:, : change or None].sum(axis=(1, 2))).tolist(),
        "delays": delays.tolist(),
        "share_outside": float(beyond[:, -1].any(axis=1).mean()),
        "limit": robots[0].limit,
        "noticed": sum(not each.serial for each in small),
        "noticed_of_robots": sum(bool(each.serial) for each in small),
        "scale": float(np.mean([each.scale for each in small if not each.serial] or [1.0])),
        "charts": len(about.names),
        "sigma_ratio": float(np.sqrt(np.mean(np.sum(about.spread**2, axis=1) / about.sigmas**2))),
    }


def of_plant(seed: int, rate: float) -> Row:
    """A mixed plant in an index: by truth, robots that the fleet says need a calibration at the end of each year."""
    about, runs = fitted(), round(YEARS * rate) + 1
    rng, began, found = np.random.default_rng(seed), dates(runs, rate), {}
    robots = [
        (kind, own)
        for kind, (count, *change) in PLANT.items()
        for own in drawn(rng, count, truth(*change, runs, rate))  # type: ignore[arg-type]
    ]
    with TemporaryDirectory() as folder, opened_index(Path(folder)) as index:
        first = 0
        for year in range(1, YEARS + 1):
            last = round(year * rate)
            for number, (kind, own) in enumerate(robots):
                index.put(indexed(number, kind, own, began, range(first, last + 1)))
            first, told = last + 1, fleet(index, Path(folder), now=began[last])
            found[str(year)] = {
                "calibrate": count_by_truth(robot.serial for robot in told.to_calibrate),
                "together": count_by_truth(robot.serial for robot in told.robots if robot.together),
                "groups": [f"{group.kind} {group.name}: {each.name}" for group in told.groups for each in group.moved],
            }
    return {"years": found, "charts": len(about.names)}


def indexed(number: int, kind: str, values: Floats, began: Sequence[str], places: Iterable[int]) -> list[IndexedRun]:
    """Some runs of a robot as an index holds them."""
    about, site = fitted(), "hall 9" if kind == "season" else f"hall {number % 5}"
    return [
        IndexedRun(
            run=f"calibration-{number}-{place}",
            fingerprint="made",
            settled=True,
            began=began[place],
            state="finished",
            verdict="better",
            robot_type="KR5 R1400",
            serial=f"{kind} {number:03d}",
            site=site,
            simulated=True,
            has_model=True,
            content="{}",
            parameters=tuple(
                IndexedParameter(name, unit, float(value), float(sigma), 10.0 * float(sigma))
                for name, unit, value, sigma in zip(about.names, about.units, values[place], about.sigmas, strict=True)
            ),
        )
        for place in places
    ]


def count_by_truth(found: Iterable[str]) -> dict[str, int]:
    """How many of the robots of each truth are among these serials."""
    serials = list(found)
    return {kind: sum(serial.startswith(kind) for serial in serials) for kind in PLANT}


def measure(kind: str, seed: int, case: str = "", size: float = 0.0, rate: str = "") -> Row:
    """Of each kind of unit."""
    if kind == "charts":
        return of_charts(case, size, RATES[rate], seed)
    if kind == "plant":
        return of_plant(seed, RATES[rate])
    model = by_wires(seed) if kind == "wires" else campaign(seed, size)
    return {"values": {each["name"]: each["value"] for each in model["parameters"] if charted(each)}}


def units(asked: Namespace) -> Iterator[Row]:
    """Campaigns first, as the other figures stand on them."""
    yield from each(kind=["campaign"], size=[0.0], seed=range(1, asked.campaigns + 1))
    yield from each(kind=["campaign"], size=[CAMPAIGN_STEP_DEG], seed=range(1, asked.campaigns // 3 + 1))
    yield from each(kind=["charts"], case=["unchanged"], size=[0.0], rate=[*RATES], seed=asked.seeds)
    yield from each(kind=["charts"], case=["σ stated half", "season"], size=[0.0], rate=["monthly", "weekly"], seed=[1])
    yield from each(kind=["charts"], case=["collision"], size=STEPS_DEG, rate=["monthly", "weekly"], seed=[1])
    yield from each(kind=["charts"], case=["wear"], size=WEAR_DEG, rate=["monthly", "weekly"], seed=[1])
    yield from each(kind=["plant"], rate=["monthly"], seed=[1])
    yield from each(kind=["wires"], seed=WIRED_TOUCHES[: asked.wires])


def tables(rows: list[Row], asked: Namespace) -> Iterator[Table]:
    """Those with rows."""
    del asked
    of = {kind: [row for row in rows if row["kind"] == kind] for kind in ("campaign", "charts", "plant", "wires")}
    if of["campaign"]:
        yield Table("\n".join(of_campaigns(of["campaign"], of["wires"])), "fleet campaigns")
    if of["charts"]:
        yield Table("\n".join(of_false_alarms(of["charts"])), "fleet false alarms")
        yield Table("\n".join(of_delays(of["charts"])), "fleet delays")
    if of["plant"]:
        yield Table("\n".join(of_years(of["plant"])), "fleet plant")


def of_campaigns(rows: list[Row], wires: list[Row]) -> Iterator[str]:
    """Scatter of whole campaigns against that of the draws, and the change that they show of a moved zero."""
    about = fitted()
    same = [row for row in rows if row["size"] == 0.0]
    moved = [row for row in rows if row["size"] != 0.0]
    values, after, wired = (
        np.array([[row["values"].get(name, np.nan) for name in about.names] for row in part]).reshape(
            -1, len(about.names)
        )
        for part in (same, moved, wires)
    )
    drawn_sigma = np.linalg.norm(about.spread, axis=1)
    middle = np.nanmean(values, axis=0)
    yield "| whole campaigns | number | figure | found | of the draws |"
    yield "|---|---|---|---|---|"
    ratios = np.nanstd(values, axis=0, ddof=1) / drawn_sigma
    quantiles = ", ".join(f"{each:.2f}" for each in np.quantile(ratios, (0.1, 0.5, 0.9)))
    one = f"| of one robot | {len(values)}"
    yield f"{one} | scatter / that of the draws: 10, 50, 90 % of the parameters | {quantiles} | 1 |"
    stated = np.nanstd(values, axis=0, ddof=1) / about.sigmas
    expected = rms(drawn_sigma / about.sigmas)
    yield f"{one} | scatter / stated σ, RMS of the parameters | {rms(stated):.2f} | {expected:.2f} |"
    z = (values - middle) / (drawn_sigma * np.sqrt(1.0 - 1.0 / len(values)))
    yield f"{one} | share beyond 2 σ | {100 * np.mean(np.abs(z) > 2.0):.1f} % | 4.6 % |"
    if len(moved):
        place, n = about.names.index(MOVED), len(moved)
        found = np.rad2deg(np.nanmean(after[:, place]) - middle[place])
        error = np.rad2deg(drawn_sigma[place]) * np.sqrt(1.0 / n + 1.0 / len(values))
        expected = CAMPAIGN_STEP_DEG * about.gain[place, about.all.index(MOVED)]
        change = f"mean change of its parameter | {found:.4f} ± {error:.4f}° | {expected:.4f}°"
        yield f"| zero of joint 3 moved by {CAMPAIGN_STEP_DEG}° | {n} | {change} |"
    if len(wired):
        z = (wired - middle) / (drawn_sigma * np.sqrt(1.0 + 1.0 / len(values)))
        yield f"| by `cellctl run` | {len(wired)} | RMS deviation from that mean, σ of the draws | {rms(z):.2f} | 1 |"


def rms(values: Floats) -> float:
    """Root mean square of the known values."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def of_false_alarms(rows: list[Row]) -> Iterator[str]:
    """Of robots that did not change, and of a season."""
    yield (
        "| truth | checks | robots | limit, σ | alarms of a robot in five years: mean | none, one, two, more "
        "| outside at the end | parameters with a σ called too small |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    cases = dict.fromkeys((row["case"], row["rate"]) for row in rows if row["case"] not in ("collision", "wear"))
    for case, rate in cases:
        mine = [row for row in rows if (row["case"], row["rate"]) == (case, rate)]
        counts = np.sum([np.pad(row["alarms"], (0, 1000 - len(row["alarms"]))) for row in mine], axis=0)
        robots = int(counts.sum())
        mean = float(counts @ np.arange(len(counts)) / robots)
        shares = [100.0 * each / robots for each in (*counts[:3], counts[3:].sum())]
        outside = 100.0 * float(np.mean([row["share_outside"] for row in mine]))
        noticed = f"{np.mean([row['noticed'] for row in mine]):.0f} of {mine[0]['charts']}"
        limit = float(np.mean([row["limit"] for row in mine]))
        yield (
            f"| {case} | {rate} | {robots} | {limit:.2f} | {mean:.2f} | {', '.join(f'{each:.0f}' for each in shares)} %"
            f" | {outside:.1f} % | {noticed} |"
        )


def of_delays(rows: list[Row]) -> Iterator[str]:
    """Of collisions and wear."""
    yield (
        "| change of the zero of joint 3 | checks | found within five years "
        "| at which run after it: 10, 50, 90 % of the robots found | days, median |"
    )
    yield "|---|---|---|---|---|"
    for row in rows:
        if row["case"] in ("collision", "wear"):
            delays = np.array(row["delays"])
            found = delays[delays > 0]
            size = f"{row['size']}°" + (" a year" if row["case"] == "wear" else "")
            quantiles = np.quantile(found, (0.1, 0.5, 0.9)) if len(found) else [np.nan] * 3
            runs = ", ".join(f"{each:.0f}" for each in quantiles)
            days = quantiles[1] * 365.25 / RATES[row["rate"]]
            share = 100.0 * len(found) / len(delays)
            yield f"| {row['case']}, {size} | {row['rate']} | {share:.0f} % | {runs} | {days:.0f} |"


def of_years(rows: list[Row]) -> Iterator[str]:
    """What the fleet says at the end of each year."""
    yield "| truth | robots | called to calibrate after 1, 2, 3, 4, 5 years | of those *as other robots* |"
    yield "|---|---|---|---|"
    for kind, (count, *_) in PLANT.items():
        for row in rows:
            years = [row["years"][f"{year}"] for year in range(1, YEARS + 1)]
            called, together = (
                ", ".join(str(year[name][kind]) for year in years) for name in ("calibrate", "together")
            )
            yield f"| {kind} | {count} | {called} | {together} |"


OPTIONS = {
    "--campaigns": {"type": int, "default": 60, "help": "whole campaigns of one robot (60)"},
    "--wires": {"type": int, "default": 3, "help": "of them by `cellctl run` (3)"},
}
STUDY = Study(units, measure, tables, seeds=3, first=1, options=OPTIONS, writes=True)
