"""The RSI context behind the ETHERNET object: held outputs, the late counter, AXISCORR and its monitor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from sims.krc.ethernet_config import Element
from sims.scene.motions import Joints


@final
class EthernetOutputs:
    """The ETHERNET object's outputs that are `wired`, zero at first; a missed answer resets those without HOLDON."""

    def __init__(self, wired: Sequence[Element]) -> None:
        self._values = {element.tag: 0.0 for element in wired}
        self._reset = [element.tag for element in wired if not element.hold_on]

    def __getitem__(self, tag: str) -> float:
        return self._values[tag]

    def answered(self, values: Mapping[str, float]) -> None:
        """A valid answer came; a tag that it left out counts as missed."""
        self.missed()
        self._values.update(values)

    def missed(self) -> None:
        """No valid answer came in this cycle."""
        for tag in self._reset:
            self._values[tag] = 0.0


@final
class LateCounter:
    """Cycles without a valid answer; more than `tolerated` and the ETHERNET object gives up.

    Whether a valid answer resets the count is not published, so both are here: counter `total` never does, `reset`
    does. `count` is what the telegram's Delay shows.
    """

    def __init__(self, tolerated: int, counter: str) -> None:
        self.count = 0
        self._tolerated = tolerated
        self._resets = counter == "reset"

    def begin(self) -> None:
        """RSI_ON: counting begins anew."""
        self.count = 0

    def answered(self) -> None:
        """A cycle with a valid answer."""
        if self._resets:
            self.count = 0

    def missed(self) -> bool:
        """A cycle without one. True where that was one too many."""
        self.count += 1
        return self.count > self._tolerated


@final
class AxisCorrection:
    """AXISCORR and AXISCORRMON: each axis clamped without a word, a greater total stops RSI. Degrees from RSI_ON.

    `relative`: the program's RSI_ON(#RELATIVE), where each cycle's value is added to the correction so far, and the
    clamp holds the sum. What is clamped away is not kept [unconfirmed]: the way back begins at the limit.
    """

    def __init__(self, limit_deg: float = 5.0, monitor_deg: float = 6.0, *, relative: bool = False) -> None:
        self._limit = limit_deg
        self._monitor = monitor_deg
        self._relative = relative

    def after(self, correction: Joints, values: Sequence[float]) -> Joints:
        """The correction one cycle on, with `values` at AXISCORR's inputs."""
        asked = [a + b for a, b in zip(correction, values, strict=True)] if self._relative else values
        return tuple(max(-self._limit, min(self._limit, angle)) for angle in asked)

    def exceeded(self, correction: Joints) -> bool:
        """Whether the overall correction is over its ceiling (KSS29000)."""
        return any(abs(angle) > self._monitor for angle in correction)
