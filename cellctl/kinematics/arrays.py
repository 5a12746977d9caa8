"""The array types of the pure packages."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
"""Array of float64; shapes are stated in docstrings, batches as leading axes `(..., 4, 4)`."""

Bools: TypeAlias = NDArray[np.bool_]
"""Array of truth values."""
