"""Measuring with an instrument: frames, poses, checks of station and robot, performance figures. Pure: arrays only."""

from cellctl.metrology.axis_frames import (
    AxisFrames,
    ParallelAxes,
    Turn,
    axis_frames,
    reflector_on_flange,
    station,
)
from cellctl.metrology.circles import Circle, NoCircle, fit_circle
from cellctl.metrology.control_chart import ControlChart, Signal, control_chart
from cellctl.metrology.daily_check import CheckLimits, DailyBaseline, DailyVerdict, daily_check, rigid_and_scale
from cellctl.metrology.floor import FloorRatio, expected_floor, floor_ratio
from cellctl.metrology.four_point import FoundTool, tool_at_point
from cellctl.metrology.gravity import Gravity, gravity_in_base
from cellctl.metrology.iso9283 import Performance, cube_points, performance
from cellctl.metrology.measured_pose import MeasuredPose, nees, nees_range
from cellctl.metrology.monuments import Growth, NestLoose, StationMotion, StationState, robot_growth, station_motion
from cellctl.metrology.nests import NestMeasuredTwice, NestPlate, NestsDoNotFit, NestsSwapped, plate_pose
from cellctl.metrology.points import Points
from cellctl.metrology.reflector_constant import ConstantError, InsensitiveDistances, KnownDistance, constant_error
from cellctl.metrology.rigid import RigidFit, rigid_transform
from cellctl.metrology.settling import Settling, SettlingLimits, settling
from cellctl.metrology.two_face import TwoFaceCheck, TwoFaceLimits, two_face_check

__all__ = [
    "AxisFrames",
    "CheckLimits",
    "Circle",
    "ConstantError",
    "ControlChart",
    "DailyBaseline",
    "DailyVerdict",
    "FloorRatio",
    "FoundTool",
    "Gravity",
    "Growth",
    "InsensitiveDistances",
    "KnownDistance",
    "MeasuredPose",
    "NestLoose",
    "NestMeasuredTwice",
    "NestPlate",
    "NestsDoNotFit",
    "NestsSwapped",
    "NoCircle",
    "ParallelAxes",
    "Performance",
    "Points",
    "RigidFit",
    "Settling",
    "SettlingLimits",
    "Signal",
    "StationMotion",
    "StationState",
    "Turn",
    "TwoFaceCheck",
    "TwoFaceLimits",
    "axis_frames",
    "constant_error",
    "control_chart",
    "cube_points",
    "daily_check",
    "expected_floor",
    "fit_circle",
    "floor_ratio",
    "gravity_in_base",
    "nees",
    "nees_range",
    "performance",
    "plate_pose",
    "reflector_on_flange",
    "rigid_and_scale",
    "rigid_transform",
    "robot_growth",
    "settling",
    "station",
    "station_motion",
    "tool_at_point",
    "two_face_check",
]
