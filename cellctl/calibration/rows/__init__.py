"""Kinds of measurement, each a block of rows: residuals from the model, and their derivatives.

A block is of one kind and of one session; several of them make a `RowBlocks`.
"""

from cellctl.calibration.rows.fixed_points import PlaneRows, SocketRows, SpacingRows, TouchRows
from cellctl.calibration.rows.instrument import PoseRows, PositionRows
from cellctl.calibration.rows.kind import Rows
from cellctl.calibration.rows.kind import RowsAtJoints as Measured

__all__ = ["Measured", "PlaneRows", "PoseRows", "PositionRows", "Rows", "SocketRows", "SpacingRows", "TouchRows"]
