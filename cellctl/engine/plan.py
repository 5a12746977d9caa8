"""The engine's input: a procedure that is ready to run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from cellctl.devices import Device
from cellctl.procedure import Procedure, StepRegistry


@final
@dataclass(slots=True)
class Plan:
    """The procedure with its parameters' values, the step kinds, and the devices by name."""

    procedure: Procedure
    parameters: Mapping[str, Any]
    registry: StepRegistry
    devices: dict[str, Device]
