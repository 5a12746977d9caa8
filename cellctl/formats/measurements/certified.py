"""Known distances between fixed points: from an artefact file, or stated as text: `A,B=50±0.01`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, final

from cellctl.files import InputError, Problem
from cellctl.formats.artefact import Artefact
from cellctl.formats.measurements.sessions import Points

if TYPE_CHECKING:
    from cellctl.calibration import SpacingRows
    from cellctl.kinematics import Floats

_WORDS = re.compile(
    r"\s*(?P<first>[^,=]+?)\s*,\s*(?P<second>[^,=]+?)\s*=\s*(?P<mm>[\d.]+)\s*(?:±|\+-)\s*(?P<sigma>[\d.]+)\s*"
)


@final
@dataclass(frozen=True, slots=True)
class Spacing:
    """The distance between two fixed points, mm, and its 1 σ, mm."""

    between: tuple[str, str]
    mm: float
    sigma: float

    @classmethod
    def parse(cls, words: str) -> Self:
        """From `A,B=50±0.01` (or `+-`). Raises InputError."""
        found = _WORDS.fullmatch(words)
        try:
            assert found is not None
            spacing = cls((found["first"], found["second"]), float(found["mm"]), float(found["sigma"]))
            assert spacing.mm > 0.0 < spacing.sigma
        except (AssertionError, ValueError):
            what = f"'{words}' is no distance between two points"
            raise InputError(Problem("--spacing", 0, 0, what, "write A,B=50±0.01 (or 50+-0.01), mm and 1 σ")) from None
        if spacing.between[0] == spacing.between[1]:
            raise InputError(Problem("--spacing", 0, 0, f"'{words}': a distance is between two points", "name both"))
        return spacing


def spacing_rows(
    points: Points, artefact: Artefact | None, said: Sequence[Spacing], *, use_artefact: bool = True
) -> SpacingRows | None:
    """The known distances between points of the data, once for each session; None where there is none.

    Raises InputError where a `said` distance is between points that no row names.
    """
    import numpy as np

    from cellctl.calibration import SpacingRows

    known = known_spacings(artefact if use_artefact else None, _named(points, said))
    rows = [(pair, each) for each in known for pair in points.pairs(*each.between)]
    if not rows:
        return None
    pairs = np.array([pair for pair, _ in rows])
    return SpacingRows(pairs, np.array([each.mm for _, each in rows]), np.array([[each.sigma] for _, each in rows]))


def known_spacings(artefact: Artefact | None, said: Sequence[Spacing]) -> list[Spacing]:
    """The artefact's certified distances, and those `said`."""
    certified = artefact.distances if artefact else []
    return [*(Spacing((item.between[0], item.between[1]), item.mm, item.sigma) for item in certified), *said]


def rough_places(points: Points, artefact: Artefact | None) -> Floats | None:
    """Rough places of the points (S, 3), mm, from the artefact; NaN where it has none, or where the robot was set up
    anew between sessions.
    """
    import numpy as np

    if artefact is None or not points.keys:
        return None
    once = [point == name for point, (name, _) in zip(points.names, points.keys, strict=True)]
    centres = [artefact.place(name) if alone else None for (name, _), alone in zip(points.keys, once, strict=True)]
    return np.array([centre or [math.nan] * 3 for centre in centres], float)


def refuse_planes(planes: Sequence[str], said: Sequence[Spacing]) -> None:
    """Raise InputError where a distance in `said` is to one of the `planes`."""
    for name in dict.fromkeys(name for each in said for name in each.between if name in planes):
        raise InputError(Problem("--spacing", 0, 0, f"'{name}' is a plane", "name spheres, sockets or anchors"))


def _named(points: Points, said: Iterable[Spacing]) -> list[Spacing]:
    wanted = list(said)
    names = {name for name, _ in points.keys}
    unknown = dict.fromkeys(name for each in wanted for name in each.between if name not in names)
    if unknown:
        known = f"points here: {', '.join(sorted(names)[:12])}" if names else "no row names a point"
        raise InputError(Problem("--spacing", 0, 0, f"no point '{name}'", known) for name in unknown)
    return wanted
