"""A UR10 as a textbook has it: one 4×4 matrix a link, multiplied one after another; of batches, but nothing clever.

`save_rows` writes positions of it with errors, as an instrument beside it would measure them.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

UR10 = np.array(
    [  # alpha, a, theta, d of each link (Craig's convention), rad and mm: pybotics' own table of this robot
        [0.0, 0.0, 0.0, 118.0],
        [np.pi / 2, 0.0, np.pi, 0.0],
        [0.0, 612.7, 0.0, 0.0],
        [0.0, 571.6, 0.0, 163.9],
        [-np.pi / 2, 0.0, 0.0, 115.7],
        [np.pi / 2, 0.0, np.pi, 92.2],
    ]
)

SIGMA = 0.05
"""1 σ of a coordinate as the rows have it, mm."""
NOMINAL = {"base": np.array([1200.0, -300.0, 40.0, 0.3, 0.02, -0.01]), "tool": np.array([30.0, -50.0, 120.0, 0, 0, 0])}
OFF = {"base": np.array([1.0, 1.0, 2.0, 0.001, 0.001, 0.001]), "tool": np.array([1.0, 1.0, 1.0, 0, 0, 0])}
LINK_ERRORS = np.array([np.deg2rad(0.05), 0.5, np.deg2rad(0.05), 0.5])
MIDDLE, SPAN = np.deg2rad([0, -80, 0, 0, 0, 0]), np.deg2rad([170, 60, 120, 170, 170, 170])
WILD_MM = 20.0
FRESH = 300


def link_frames(links, q):
    """Frames behind each joint, each (N, 4, 4), mm, at q (N, n), rad; the last is the flange's."""
    frame, frames = np.eye(4), []
    for (alpha, a, theta, d), angle in zip(links, q.T, strict=True):
        ca, sa, c, s = np.cos(alpha), np.sin(alpha), np.cos(theta + angle), np.sin(theta + angle)
        link = np.zeros((len(q), 4, 4))
        link[:, 0, 0], link[:, 0, 1], link[:, 0, 3] = c, -s, a
        link[:, 1, 0], link[:, 1, 1], link[:, 1, 2], link[:, 1, 3] = s * ca, c * ca, -sa, -d * sa
        link[:, 2, 0], link[:, 2, 1], link[:, 2, 2], link[:, 2, 3] = s * sa, c * sa, ca, d * ca
        link[:, 3, 3] = 1.0
        frame = frame @ link
        frames.append(frame)
    return frames


def forward(links, q):
    """The flange's pose (N, 4, 4), mm."""
    return link_frames(links, q)[-1]


def forward_and_jacobian(links, q):
    """The flange's pose (N, 4, 4) and how it moves with the joints (N, 6, n): mm/rad, then rad/rad."""
    frames = link_frames(links, q)
    end = frames[-1][:, :3, 3]
    columns = [
        np.concatenate([np.cross(frame[:, :3, 2], end - frame[:, :3, 3]), frame[:, :3, 2]], axis=1) for frame in frames
    ]
    return frames[-1], np.stack(columns, axis=-1)


def save_rows(path, count, *, scatter=1.0, outlying=0.0):
    """`count` positions that scatter by `scatter` σ, a share `outlying` of them centimetres off, and FRESH exact ones.

    Errors of half a millimetre and a twentieth of a degree in each link. The names in the file: see `serving.Rows`.
    """
    rng = np.random.default_rng(5)
    links = UR10 + LINK_ERRORS * rng.normal(size=UR10.shape)
    base, tool = (_frame(NOMINAL[name] + OFF[name] * rng.normal(size=6)) for name in ("base", "tool"))
    q, held_out_q = (MIDDLE + SPAN * rng.uniform(-1, 1, (rows, 6)) for rows in (count, FRESH))
    xyz, held_out_xyz = ((base @ forward(links, each) @ tool)[:, :3, 3] for each in (q, held_out_q))
    xyz = xyz + rng.normal(0, scatter * SIGMA, xyz.shape)
    xyz[: round(outlying * count)] += rng.normal(0, WILD_MM, (round(outlying * count), 3))
    rows = {"q": q, "xyz": xyz, "held_out_q": held_out_q, "held_out_xyz": held_out_xyz}
    np.savez(path, links=UR10, sigma=SIGMA, **NOMINAL, **rows)
    return path


def _frame(vector):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_euler("ZYX", vector[3:]).as_matrix(), vector[:3]
    return matrix
