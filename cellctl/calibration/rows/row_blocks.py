"""Rows of several kinds and sessions as one set, numbered block after block."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows import Measured
from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, eq=False)
class RowBlocks:
    """Blocks of rows, each of one kind and one session, some possibly empty; M rows in all."""

    blocks: tuple[Measured, ...]

    @classmethod
    def of(cls, rows: Self | Measured | Sequence[Measured]) -> Self:
        """Row blocks unchanged; one block, or several, as row blocks."""
        if isinstance(rows, cls):
            return rows
        return cls(tuple(rows) if isinstance(rows, list | tuple) else (rows,))  # type: ignore[arg-type]

    def __len__(self) -> int:
        return int(self._starts[-1])

    @cached_property
    def _starts(self) -> Floats:
        return np.concatenate([[0], np.cumsum([len(block) for block in self.blocks])])

    @property
    def only(self) -> Measured:
        """The only block. Raises ValueError where there are several, or none."""
        (block,) = self.blocks
        return block

    @property
    def q(self) -> Floats:
        """Model angles (M, n), rad."""
        return np.concatenate([block.q for block in self.blocks])

    @property
    def of_instrument(self) -> Bools:
        """Which rows (M,) are measured in an instrument's own frame."""
        return np.concatenate([np.full(len(block), block.of_instrument) for block in self.blocks])

    @property
    def has_positions(self) -> bool:
        """Whether an instrument measured TCPs in any row."""
        return any(block.positions is not None for block in self.blocks if len(block))

    @property
    def has_distances(self) -> bool:
        """Whether any row is a measured distance from a fixed point."""
        return any(block.distances is not None for block in self.blocks if len(block))

    @property
    def numbers(self) -> Any:
        """Count of numbers in each row (M,)."""
        return np.concatenate([np.full(len(block), len(block.quantities)) for block in self.blocks])

    @property
    def size(self) -> int:
        """Total count of numbers."""
        return sum(block.sigma.size for block in self.blocks)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Kind of each number of a row, block after block: there is one noise factor for each of these."""
        return tuple(quantity for block in self.blocks for quantity in block.quantities)

    @property
    def kinds(self) -> frozenset[type[Measured]]:
        """Kinds of rows present."""
        return frozenset(type(block) for block in self.blocks if len(block))

    def parts(self) -> Iterator[tuple[Measured, slice, slice]]:
        """Each block with the places of its rows among the M, and of its numbers among `quantities`."""
        start = 0
        for index, block in enumerate(self.blocks):
            own = slice(start, start := start + len(block.quantities))
            yield block, slice(int(self._starts[index]), int(self._starts[index + 1])), own

    def pick(self, which: Any) -> Self:
        """The rows at `which` (indices in ascending order, or a mask); no block is dropped, some may be empty."""
        chosen = np.sort(np.arange(len(self))[which])
        cuts = np.searchsorted(chosen, self._starts)
        return type(self)(
            tuple(
                block.pick(chosen[begin:end] - first)
                for block, begin, end, first in zip(self.blocks, cuts, cuts[1:], self._starts, strict=False)
            )
        )

    def noisier(self, factors: Floats) -> Self:
        """The same rows with their standard deviations times `factors`, one for each of `quantities`."""
        return type(self)(tuple(block.noisier(factors[own]) for block, _, own in self.parts()))

    def errors(self, state: State) -> Floats:
        """Distance (M,) between model and measurement, mm."""
        return np.concatenate([np.zeros(0), *(block.errors(state) for block in self.blocks)])
