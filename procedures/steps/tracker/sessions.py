"""In which session of the data set each measured pose is: the visits to the monuments before and after it decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, final

import numpy as np

from cellctl.kinematics import Floats, inverse_pose
from cellctl.records import Rows
from procedures.steps.tracker.rows import MonumentsRow, PoseRow, StationRow, VisitedRow
from procedures.steps.tracker.station import FIRST_SESSION


@final
@dataclass(frozen=True, eq=False)
class Sessions:
    """The sessions of a run. of_visit: session at each visit; places: session → the instrument, base frame.

    first: the session of the first pose that has one; a model's frame is the instrument's in it.
    """

    of_visit: Sequence[str]
    places: dict[str, Floats]
    first: str = FIRST_SESSION

    @classmethod
    def of(cls, rows: Rows) -> Self:
        """From the recorded visits; the last place of each session counts."""
        visits = sorted(rows.recorded(MonumentsRow), key=lambda row: row.visit)
        places = {row.session: np.array(row.matrix) for row in rows.recorded(StationRow)}
        found = cls([row.session for row in visits], places)
        known = (found.session(row.visit) for row in rows.recorded(PoseRow))
        return replace(found, first=next(filter(None, known), FIRST_SESSION))

    def session(self, visit: int) -> str | None:
        """The session of a pose that was measured before visit number `visit`; None if the station moved about then."""
        if not self.of_visit:
            return FIRST_SESSION
        before = self.of_visit[max(0, visit - 1)]
        after = self.of_visit[min(visit, len(self.of_visit) - 1)]
        return before if before == after else None

    def place(self, row: VisitedRow) -> Floats | None:
        """The measured place (3,), mm, in the instrument's frame of the first session; None without a session."""
        session = self.session(row.visit)
        return None if session is None else self.to_first(session, np.array([row.point.xyz]))[0]

    def to_first(self, session: str, places: Floats) -> Floats:
        """Places (N, 3) of the instrument's frame in `session` in that of the first session, mm."""
        if session == self.first:
            return places
        change = inverse_pose(self.places[self.first]) @ self.places[session]
        return np.asarray(places @ change[:3, :3].T + change[:3, 3])
