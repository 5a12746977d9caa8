"""The cell file: which devices there are and where, the robot's file, limits, the artefact, how to simulate them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.devices.addresses import Address
from cellctl.devices.protocols import Surroundings
from cellctl.devices.registry import DriverRegistry
from cellctl.files import Document, InputError, Problem, load_yaml
from cellctl.files.validated import validated

ClockMode = Literal["realtime", "lockstep"]


class _Simulate(BaseModel):
    model_config = ConfigDict(extra="allow")  # the simulators read, and check, the rest
    seed: int = Field(default=1, ge=0)
    clock: ClockMode = "lockstep"


class _CellModel(BaseModel):
    model_config = ConfigDict(extra="allow")  # every other key is a device
    name: str
    model: str
    limits: dict[str, dict[str, float]] = Field(default_factory=dict)
    artefact: dict[str, Any] | None = None
    simulate: _Simulate | None = None


@final
@dataclass(frozen=True)
class Cell:
    """A cell file as loaded.

    `addresses`: device name → address; `robot_file`: the nominal robot; `limits`: device name → limits of its lowest
    layer; `simulated`: the file says how to simulate its devices, with `seed` and `clock` as it says.
    """

    document: Document
    name: str
    path: Path
    robot_file: Path
    addresses: dict[str, Address]
    limits: dict[str, dict[str, float]]
    simulated: bool
    seed: int
    clock: ClockMode

    @classmethod
    def load(cls, path: Path, drivers: DriverRegistry) -> Self:
        """Load and check a cell file; opens no device. Raises InputError with every mistake."""
        document = load_yaml(path)
        if not isinstance(document.data, dict):
            raise InputError(document.problem((), "is not a cell file", "it is a mapping: name, model, devices …"))
        model = validated(document, _CellModel)
        addresses, problems = _addresses(document, model, drivers, path.parent)
        robot_file = path.parent / model.model
        if not robot_file.is_file():
            problems.append(document.problem(("model",), f"there is no robot file '{model.model}'", "check the path"))
        for name in model.limits.keys() - addresses.keys():
            problems.append(document.problem(("limits", name), f"limits for '{name}', which is no device", key=True))
        if problems:
            raise InputError(problems)
        simulate = model.simulate or _Simulate()
        return cls(
            document=document,
            name=model.name,
            path=path,
            robot_file=robot_file,
            addresses=addresses,
            limits=model.limits,
            simulated=model.simulate is not None,
            seed=simulate.seed,
            clock=simulate.clock,
        )

    def surroundings(self, device: str, clock: Any) -> Surroundings:
        """What the driver of `device` is given besides its address."""
        return Surroundings(clock, self.path.parent, self.limits.get(device, {}))


def _addresses(
    document: Document, model: _CellModel, drivers: DriverRegistry, folder: Path
) -> tuple[dict[str, Address], list[Problem]]:
    addresses: dict[str, Address] = {}
    problems: list[Problem] = []
    for name, value in (model.model_extra or {}).items():
        try:
            if not isinstance(value, str):
                raise ValueError("a device is given by its address, scheme://…")
            address = Address.parse(value)
            mistakes = drivers.mistakes(name, address, folder, model.limits.get(name, {}))
        except ValueError as error:
            mistakes = [str(error)]
        else:
            addresses[name] = address
        problems += [document.problem((name,), f"{name}: {mistake}") for mistake in mistakes]
    if not addresses and not problems:
        problems.append(document.problem((), "the cell has no device", "add at least one, name: scheme://…"))
    return addresses, problems
