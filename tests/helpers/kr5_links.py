"""The published link table of the KUKA KR5 R1400 as links of a chain: A2 and A3 are parallel."""

import numpy as np

from cellctl.kinematics import Link
from tests.helpers.kr5_table import KR5_TABLE

KR5_LINKS = [
    Link(np.deg2rad(theta), d, a, np.deg2rad(alpha), 0.0 if index == 1 else None)
    for index, (theta, d, a, alpha) in enumerate(KR5_TABLE)
]
