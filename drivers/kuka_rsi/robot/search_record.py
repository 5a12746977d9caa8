"""The samples of a search from the ring, and the result made from them."""

from __future__ import annotations

from typing import final

from cellctl.clock import MinimumDelayFit
from cellctl.devices import JointReadings, SearchEnd, SearchResult
from drivers.kuka_rsi.cyclic.shared_block import Sample, SearchStatus, SharedBlock, Slot

_ALL_OF_IT_S = 86_400.0


@final
class SearchRecord:
    """Collects one search's samples and counts from the shared block."""

    def __init__(self, block: SharedBlock, number: int) -> None:
        self.samples: list[Sample] = []
        self._block = block
        self._number = number
        self._tail = block.words[Slot.HEAD]
        self._before = self._counts()

    def collect(self) -> None:
        """Read the new samples; call it before the ring overwrites them."""
        new, self._tail = self._block.samples(self._tail)
        self.samples += [sample for sample in new if sample.search == self._number]

    def counts(self) -> dict[str, int]:
        """`late`, `lost` and `skipped` telegrams of this search; late: the larger of our count and the controller's."""
        rises = {slot: now - self._before[slot] for slot, now in self._counts().items()}
        late = max(rises[Slot.LATE], rises[Slot.LATE_REPORTED])
        return {"late": late, "lost": rises[Slot.LOST], "skipped": rises[Slot.SKIPPED]}

    def result(self, end: SearchEnd, status: SearchStatus, resting: JointReadings) -> SearchResult:
        """The record of the search, its samples' times through the count → cell clock fit."""
        return SearchResult(
            end=end,
            times_ns=self._times(status),
            ipoc=tuple(sample.ipoc for sample in self.samples),
            joints=tuple(sample.joints for sample in self.samples),
            resting=resting,
            stop_cycles=status.stop_cycles,
            **self.counts(),
        )

    def _times(self, status: SearchStatus) -> tuple[int, ...]:
        if not status.ipoc_step:
            return tuple(sample.arrival_ns for sample in self.samples)
        fit = MinimumDelayFit(_ALL_OF_IT_S)
        stamps = [sample.ipoc * status.cycle_ns // status.ipoc_step for sample in self.samples]
        for stamp, sample in zip(stamps, self.samples, strict=True):
            fit.add(stamp, sample.arrival_ns)
        line = fit.fit()
        return tuple(map(line.to_cell_ns, stamps))

    def _counts(self) -> dict[Slot, int]:
        slots = (Slot.LATE, Slot.LATE_REPORTED, Slot.LOST, Slot.SKIPPED)
        return {slot: self._block.words[slot] for slot in slots}
