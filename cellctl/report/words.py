"""What the figures mean, in sentences."""

from __future__ import annotations

import re

from cellctl.report.numbers import fixed, with_sigma

_WITH_CENTRES = (
    "The robot as a whole turns or shifts at its base and all that was measured goes with it: no row changes. It is "
    "where the robot stands, not what shape it is."
)
_AT_TOOL = (
    "The last link and the tool frame are bolted together: what one gains the other loses, and the tool centre point "
    "stays where it is. Only their sum moves the tip, and the sum is seen."
)
OTHERWISE = (
    "The rows of the fit do not tell these parameters apart. What is not seen stays at its nominal value, within "
    "its tolerance; its share is in every σ of this report."
)

_LINK = re.compile(r"\b([θdaαβ])(\d+)\b")


def unseen_with_reason(phrases: list[str], joints: int) -> list[tuple[str, list[str]]]:
    """Why each combination that was not seen is not: the reason, and the combinations that it holds for.

    phrases: as the fit words them; joints: how many the robot has.
    """
    found: dict[str, list[str]] = {}
    for phrase in phrases:
        found.setdefault(_reason(phrase, joints), []).append(phrase)
    return list(found.items())


def mean_with_uncertainty(mean: float, rms: float, count: int) -> str:
    """`0.0133 ± 0.0027`: the mean of `count` errors, mm, and its standard uncertainty s/√n."""
    if count < 2:
        return fixed(mean)
    spread = max(rms * rms - mean * mean, 0.0) * count / (count - 1)
    return with_sigma(mean, (spread / count) ** 0.5)


def _reason(phrase: str, joints: int) -> str:
    """Only the first joint's θ and d with the base, and the last link's with the tool, are known to do no harm."""
    links = set(_LINK.findall(phrase))
    outside = "centre" in phrase or "base" in phrase
    if outside and "tool" not in phrase and links and links <= {("θ", "1"), ("d", "1")}:
        return _WITH_CENTRES
    if not outside and "tool translation" in phrase and {number for _, number in links} == {str(joints)}:
        return _AT_TOOL
    return OTHERWISE
