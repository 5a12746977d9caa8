"""What the engine is to run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from cellctl.devices import Device
from cellctl.procedure import Procedure, StepRegistry


@final
@dataclass(slots=True)
class Plan:
    """What to run: the procedure with its parameters' values, the kinds of steps, and the devices by name."""

    procedure: Procedure
    parameters: Mapping[str, Any]
    registry: StepRegistry
    devices: dict[str, Device]
