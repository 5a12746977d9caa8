"""Kinds of measurement, each a block of rows: residuals from the model, and their derivatives.

A block is of one kind and of one session; several of them make a `RowBlocks`.
"""

from cellctl.calibration.rows._instrument import PoseRows, PositionRows
from cellctl.calibration.rows._kind import Rows
from cellctl.calibration.rows._kind import RowsAtJoints as Measured
from cellctl.calibration.rows.fixed_points import PlaneRows, SocketRows, SpacingRows, TouchRows

__all__ = ["Measured", "PlaneRows", "PoseRows", "PositionRows", "Rows", "SocketRows", "SpacingRows", "TouchRows"]
