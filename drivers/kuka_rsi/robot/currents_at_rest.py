"""The motor currents of an RSI session at rest."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean, stdev

from cellctl.devices import DeviceFault, MotorCurrents
from drivers.kuka_rsi.axes import AXES
from drivers.kuka_rsi.cyclic.shared_block import Sample

AT_REST = (0.0,) * AXES
"""The correction of such a session."""


def mean_currents(device: str, samples: Sequence[Sample]) -> MotorCurrents:
    """Mean and 1 σ of one sample, in the unit of MACur. Raises DeviceFault if a telegram has no six numbers."""
    if not all(sample.currents for sample in samples):
        cure = "compare the RSI Ethernet configuration on the controller with the one here"
        raise DeviceFault(device, "telegrams came without readable motor currents (MACur)", cure)
    columns = list(zip(*(sample.currents for sample in samples), strict=True))
    sigmas = tuple(stdev(column) if len(column) > 1 else 0.0 for column in columns)
    middle_ns = (samples[0].arrival_ns + samples[-1].arrival_ns) // 2
    return MotorCurrents(tuple(map(fmean, columns)), sigmas, len(samples), middle_ns)
