"""The cell file: devices and addresses, robot file and reach, limits, artefact, facts for reports, simulation."""

from __future__ import annotations

import datetime
import itertools
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self, final

from pydantic import BaseModel, ConfigDict, Field, field_validator

from cellctl.clock import Clock, WallClock
from cellctl.devices._addresses import Address
from cellctl.devices._protocols import TABLE_CORRECTION_DEG, Finding, Surroundings
from cellctl.devices.registry import DriverRegistry
from cellctl.files import Document, InputError, Problem, load_yaml
from cellctl.files.kinds import CELL
from cellctl.files.validated import validated
from cellctl.installed import near, robot_file

ARTEFACT = "artefact"
"""The name of the artefact among devices, and in the uncertainties."""

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)
_Sigma = Annotated[float, Field(allow_inf_nan=False, ge=0, le=100)]

ClockMode = Literal["realtime", "lockstep"]

TABLE = "table"
"""The name in `limits:` for compensation tables; it is not a device."""

ONLINE_CORRECTION_DEG = 0.5
"""Default limit of an on-line correction of a joint, deg, that of the driver."""

_RESERVED = {
    TABLE: f"'{TABLE}' in `limits:` stands for compensation tables",
    **dict.fromkeys(("control", "time", "seed", "pid"), "the simulators' ready file has an entry of this name"),
}
"""Names that no device can have, each with the reason."""


class _Simulate(BaseModel):
    model_config = ConfigDict(extra="allow")  # the simulators read, and check, the rest
    seed: int = Field(default=1, ge=0)
    clock: ClockMode = "lockstep"


class _CellModel(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: str
    model: str
    devices: dict[str, Any] = Field(default_factory=dict)
    limits: dict[str, dict[str, float]] = Field(default_factory=dict)
    artefact: dict[str, Any] | None = None
    postures: dict[str, Any] | None = None
    station: dict[str, Any] | None = None
    reflectors: dict[str, Any] | None = None
    floor: dict[str, Any] | None = None
    currents: dict[str, Any] | None = None
    load: dict[str, Any] | None = None
    report: ReportFacts | None = None
    acceptance: list[AcceptanceCriterion] = Field(default_factory=list)
    calibration_days: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    simulate: _Simulate | None = None


@final
@dataclass(frozen=True)
class Cell:
    """A cell file as loaded.

    `addresses`: device name → address; `robot_file`: the nominal robot; `limits`: device name → limits of its lowest
    layer; `reach_mm`: the robot's maximum reach, None if its file lacks it; `table_correction_deg`: the
    largest correction of a joint by a compensation table, deg; `simulated`: the file has simulation settings,
    with `seed` and `clock` from it. `warnings`: allowed but probably unintended values.
    """

    document: Document
    name: str
    path: Path
    robot_file: Path
    addresses: dict[str, Address]
    limits: dict[str, dict[str, float]]
    reach_mm: float | None
    table_correction_deg: float
    simulated: bool
    seed: int
    clock: ClockMode
    warnings: tuple[Problem, ...] = ()

    @classmethod
    def load(cls, path: Path, drivers: DriverRegistry) -> Self:
        """Load and check a cell file; opens no device. Raises InputError with every error."""
        document = load_yaml(path, CELL)
        if not isinstance(document.data, dict):
            raise InputError(document.problem((), "is not a cell file", "it is a mapping: name, model, devices …"))
        model = _read(document, document.data)
        robot = robot_file(model.model, path.parent)
        reach_mm = reach_of(robot)
        addresses, problems = _addresses(document, model)
        place = Surroundings(WallClock(), path.parent, {}, reach_mm, axes_of(robot))
        found, warnings = _findings(document, model, addresses, drivers, place)
        problems += found
        if not robot.is_file():
            what = f"there is no robot file '{model.model}', nor a robot of this name"
            problems.append(document.problem(("model",), what, f"check the path, or {near(Path(model.model).stem)}"))
        problems += _table_limits(document, model)
        problems += unknown_instruments(document, model.report or ReportFacts(), addresses)
        problems += _two_limits(document, model)
        for name in model.limits.keys() - addresses.keys() - {TABLE}:
            problems.append(document.problem(("limits", name), f"limits for '{name}', which is no device", key=True))
        if problems:
            raise InputError(problems)
        simulate = model.simulate or _Simulate()
        return cls(
            document=document,
            name=model.name,
            path=path,
            robot_file=robot,
            addresses=addresses,
            limits=model.limits,
            reach_mm=reach_mm,
            table_correction_deg=table_correction_deg(document),
            simulated=model.simulate is not None,
            seed=simulate.seed,
            clock=simulate.clock,
            warnings=tuple(warnings),
        )

    def surroundings(self, device: str, clock: Clock, state: Path | None = None) -> Surroundings:
        """The data for the driver of `device` besides its address."""
        limits, most_deg = self.limits.get(device, {}), self.table_correction_deg
        return Surroundings(clock, self.path.parent, limits, self.reach_mm, table_correction_deg=most_deg, state=state)


def _read(document: Document, content: dict[str, Any]) -> _CellModel:
    """The file's content. Raises InputError; for an address at top level, the cure names its new place."""
    misplaced = {key for key, value in content.items() if isinstance(value, str) and "://" in value} - {"devices"}
    cure = "write it under `devices:`, as `devices: {NAME: ADDRESS}`"
    moved = [document.problem((key,), f"'{key}' is an address at top level", cure, key=True) for key in misplaced]
    devices = content.get("devices", {})
    if not isinstance(devices, dict):
        moved.append(
            document.problem(("devices",), f"`devices:` is {_kind(devices)}", "write `NAME: ADDRESS` lines below it")
        )
        misplaced.add("devices")
    rest = {key: value for key, value in content.items() if key not in misplaced}
    try:
        model = validated(replace(document, data=rest), _CellModel)
    except InputError as error:
        raise InputError([*moved, *error.problems]) from error
    if moved:
        raise InputError(moved)
    return model


def _kind(value: Any) -> str:
    """The kind of a YAML value, as text."""
    words = {list: "a list", str: "text", type(None): "empty"}
    return words.get(type(value), f"a single value ({value})")


@final
class Calibrated(BaseModel):
    """The last calibration of an instrument or of the artefact: date (ISO 8601), certificate.

    serial: of the artefact, or of an instrument that does not report the right one.
    """

    model_config = _STRICT
    date: str
    certificate: str = ""
    serial: str = ""

    @field_validator("date")
    @classmethod
    def _is_date(cls, value: str) -> str:
        try:
            return datetime.date.fromisoformat(value).isoformat()
        except ValueError:
            raise ValueError(f"'{value}' is no date; write it as 2026-03-01") from None


@final
class ReportFacts(BaseModel):
    """Customer, site, order and operator; "" where they are not stated. limit_mm: the acceptance limit of an error.

    laboratory, responsible, country: who calibrates, who answers for it, where (ISO 3166-1), for a certificate.
    calibrated: device name, or `artefact` → its last calibration. sigma_mm: source → standard uncertainty (type B) of a
    measured error, mm: along the normal for touches, 3-D for points; `artefact` and `temperature` among the sources.
    """

    model_config = _STRICT
    customer: str = ""
    site: str = ""
    order: str = ""
    operator: str = ""
    laboratory: str = ""
    responsible: str = ""
    country: Annotated[str, Field(pattern="^([A-Z]{2})?$")] = ""
    limit_mm: Annotated[float, Field(allow_inf_nan=False, gt=0)] | None = None
    calibrated: dict[str, Calibrated] = {}
    sigma_mm: dict[str, _Sigma] = {}


@final
class AcceptanceCriterion(BaseModel):
    """A limit of measured held-out errors, mm, for a `procedure` (its name) and a `robot` (serial); "": for any.

    measurand: their mean, 95 % quantile or maximum. guard: the guard band in units of its expanded uncertainty U.
    """

    model_config = _STRICT
    limit_mm: Annotated[float, Field(allow_inf_nan=False, gt=0)]
    measurand: Literal["mean", "quantile_95", "maximum"] = "maximum"
    guard: Annotated[float, Field(allow_inf_nan=False, ge=0, le=3)] = 1.0
    procedure: str = ""
    robot: str = ""


def _two_limits(document: Document, model: _CellModel) -> list[Problem]:
    if not (model.acceptance and model.report and model.report.limit_mm):
        return []
    what, cure = "`acceptance:` states the limit already", "leave `limit_mm` out"
    return [document.problem(("report", "limit_mm"), what, cure, key=True)]


def unknown_instruments(document: Document, facts: ReportFacts, devices: Collection[str]) -> list[Problem]:
    """A problem for each name under `calibrated` that is no device and not the artefact."""
    known = [*devices, ARTEFACT]
    return [
        document.problem(
            ("report", "calibrated", name), f"there is no device '{name}'", f"known are {', '.join(known)}", key=True
        )
        for name in facts.calibrated
        if name not in known
    ]


def reach_of(robot_file: Path) -> float | None:
    """The TCP's greatest distance from the first axis, mm: all links and the tool in one straight line, at most.

    Never less than the true reach. None if the file cannot be read or has no such lengths; loading it as a
    robot file reports its errors.
    """
    try:
        data = load_yaml(robot_file).data
        return sum(_lengths(data)) or None
    except (InputError, AttributeError, KeyError, TypeError, ValueError):
        return None


def axes_of(robot_file: Path) -> int | None:
    """The number of the robot's axes; None if the file cannot be read or is no robot file."""
    try:
        data = load_yaml(robot_file).data
        return len(data.get("links") or data["screws"])
    except (InputError, AttributeError, KeyError, TypeError):
        return None


def _lengths(robot: dict[str, Any]) -> Iterator[float]:
    """Length of each piece from the base to the TCP, mm."""
    for link in robot.get("links", ()):
        yield math.hypot(link.get("a", 0.0), link.get("d", 0.0))
    points = [screw["point"] for screw in robot.get("screws", ())]
    if points:
        flange = robot["home"].get("xyz", (0.0, 0.0, 0.0))
        yield from (math.dist(a, b) for a, b in itertools.pairwise([*points, flange]))
    yield math.hypot(*(robot.get("tool") or {}).get("xyz", (0.0, 0.0, 0.0)))


def table_correction_deg(document: Document) -> float:
    """The largest correction of a joint by a compensation table, deg, from the cell file: `limits: {table: …}`."""
    return _limit(document, TABLE, "correction_deg", TABLE_CORRECTION_DEG)


def online_correction_deg(document: Document) -> float:
    """The largest on-line correction of a joint, deg, from the cell file: `limits: {robot: …}`."""
    return _limit(document, "robot", "online_correction_deg", ONLINE_CORRECTION_DEG)


def _limit(document: Document, of: str, name: str, default: float) -> float:
    stated = (document.data.get("limits") or {}).get(of) or {}
    return float(stated.get(name, default))


def _table_limits(document: Document, model: _CellModel) -> list[Problem]:
    at = ("limits", TABLE)
    problems = []
    for name, value in model.limits.get(TABLE, {}).items():
        if name != "correction_deg":
            problems.append(document.problem((*at, name), f"unknown table limit '{name}'", "correction_deg", key=True))
        elif not 0.0 < value <= 45.0:
            what = f"a table's corrections cannot be limited to {value:g}°"
            problems.append(document.problem((*at, name), what, "degrees, above 0 and up to 45"))
    return problems


def _addresses(document: Document, model: _CellModel) -> tuple[dict[str, Address], list[Problem]]:
    addresses: dict[str, Address] = {}
    problems: list[Problem] = []
    for name, value in model.devices.items():
        if name in _RESERVED:
            what, cure = f"a device cannot be called '{name}'", f"give it another name: {_RESERVED[name]}"
            problems.append(document.problem(("devices", name), what, cure, key=True))
        try:
            if not isinstance(value, str):
                raise ValueError("a device is given by its address, scheme://…")
            addresses[name] = Address.parse(value)
        except ValueError as error:
            problems.append(document.problem(("devices", name), f"{name}: {error}"))
    if not addresses and not problems:
        problems.append(
            document.problem((), "the cell has no device", "add at least one, `devices: {name: scheme://…}`")
        )
    return addresses, problems


def _findings(
    document: Document,
    model: _CellModel,
    addresses: dict[str, Address],
    drivers: DriverRegistry,
    place: Surroundings,
) -> tuple[list[Problem], list[Problem]]:
    """The drivers' errors and warnings about their devices' addresses and limits."""
    problems: list[Problem] = []
    warnings: list[Problem] = []
    for name, address in addresses.items():
        surroundings = replace(place, limits=model.limits.get(name, {}))
        for found in drivers.findings(name, address, surroundings):
            (warnings if found.warning else problems).append(_placed(document, name, found))
    return problems, warnings


def _placed(document: Document, device: str, found: Finding) -> Problem:
    place = ("limits", device, found.limit) if found.limit else ("devices", device)
    return document.problem(place, f"{device}: {found.what}", found.cure, key=bool(found.limit))
