"""A UR10 as a textbook has it: one 4×4 matrix a link, multiplied one after another; of batches, but nothing clever."""

from __future__ import annotations

import numpy as np

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
