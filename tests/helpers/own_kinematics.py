"""Forward kinematics from the text of a robot file, a URDF or a DH table, with nothing of cellctl's: 4×4, mm."""

import csv
import io
import xml.etree.ElementTree as ElementTree

import numpy as np
import yaml

X, Y, Z = np.eye(3)


def turn(axis, angle, point=(0.0, 0.0, 0.0)):
    """A turn (rad) about an axis through a point, after Rodrigues."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result = np.eye(4)
    result[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    result[:3, 3] = point - result[:3, :3] @ np.asarray(point, float)
    return result


def slide(vector):
    result = np.eye(4)
    result[:3, 3] = vector
    return result


def kuka_frame(frame):
    a, b, c = np.deg2rad(frame.get("abc", [0, 0, 0]))
    return slide(frame.get("xyz", [0, 0, 0])) @ turn(Z, a) @ turn(Y, b) @ turn(X, c)


def link(row, angle, convention):
    theta, alpha, beta = (np.deg2rad(float(row.get(name) or 0.0)) for name in ("theta", "alpha", "beta"))
    joint = turn(Z, angle + theta) @ slide([0, 0, float(row.get("d") or 0.0)])
    along = slide([float(row.get("a") or 0.0), 0, 0])
    behind = turn(X, alpha) @ along @ turn(Y, beta)
    return joint @ behind if convention == "mdh-hayati" else behind @ joint


def forward_of_robot_file(text, readings):
    robot = yaml.safe_load(text)
    here = kuka_frame(robot.get("base", {}))
    angles = [
        np.deg2rad(joint.get("sign", 1) * reading + joint.get("offset", 0))
        for joint, reading in zip(robot["joints"], readings, strict=True)
    ]
    if robot["convention"] == "poe":
        for screw, angle in zip(robot["screws"], angles, strict=True):
            here = here @ turn(screw["axis"], angle, screw["point"])
        here = here @ kuka_frame(robot["home"])
    else:
        for row, angle in zip(robot["links"], angles, strict=True):
            here = here @ link(row, angle, robot["convention"])
    return here @ kuka_frame(robot.get("tool", {}))


def forward_of_urdf(text, tip, readings_rad):
    """Joint positions in the order of the chain from the root to `tip`."""
    root = ElementTree.fromstring(text)
    above = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    path = []
    while tip in above:
        path.insert(0, above[tip])
        tip = above[tip].find("parent").get("link")
    here, positions = np.eye(4), iter(readings_rad)
    for joint in path:
        origin = joint.find("origin")
        if origin is not None:
            roll, pitch, yaw = map(float, origin.get("rpy", "0 0 0").split())
            here = here @ slide([1000.0 * float(word) for word in origin.get("xyz", "0 0 0").split()])
            here = here @ turn(Z, yaw) @ turn(Y, pitch) @ turn(X, roll)
        if joint.get("type") != "fixed":
            axis = joint.find("axis")
            here = here @ turn(list(map(float, axis.get("xyz").split())) if axis is not None else X, next(positions))
    assert next(positions, None) is None
    return here


def forward_of_dh_table(text, readings):
    rows = list(csv.DictReader(io.StringIO(text)))
    frames = {
        row["joint"]: kuka_frame({"xyz": [float(row[n]) for n in "XYZ"], "abc": [float(row[n]) for n in "ABC"]})
        for row in rows
        if row["joint"] in ("base", "tool")
    }
    here = frames.get("base", np.eye(4))
    for row, reading in zip((row for row in rows if row["joint"] not in frames), readings, strict=True):
        angle = np.deg2rad(float(row["sign"] or 1) * reading + float(row["offset"] or 0))
        here = here @ link(row, angle, row["convention"])
    return here @ frames.get("tool", np.eye(4))


def assert_same_pose(found, wanted):
    np.testing.assert_allclose(found[:3, 3], wanted[:3, 3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[:3, :3], wanted[:3, :3], rtol=0, atol=1e-12)
