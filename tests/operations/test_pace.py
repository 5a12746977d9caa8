"""The time left of a fit comes from the work that it has done, and is right within a factor of two."""

import numpy as np
import pytest

from cellctl.operations.pace import TELLING, Pace, continued, time_left

STAGES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.8)
"""Shares that a part reports."""


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def told_by(times, lanes, folds):
    """(seconds since the begin, share) of all reports of a fit whose stages end at these shares of each part's time."""
    clock, told, seconds = Clock(), [], {0: 5.0, **dict.fromkeys(range(1, folds + 1), 4.0)}
    pace = Pace(lambda _, share: told.append((clock.now, share)), folds, lambda _: max(map(len, lanes)), clock)
    events = [(5.0 * at, 0, share) for share, at in zip(STAGES, times, strict=True)]
    for lane in lanes:
        for place, part in enumerate(lane):
            began = 5.0 + 4.0 * place
            events += [(began + seconds[part] * at, part, share) for share, at in zip(STAGES, times, strict=True)]
            events.append((began + seconds[part], part, None))
    model_ended = False
    for clock.now, part, share in sorted(events, key=lambda event: (event[0], event[2] is not None)):
        if part and not model_ended:
            pace.ended(0)
            pace.lanes, model_ended = lanes, True
        if share is None:
            pace.ended(part)
        else:
            pace.part(part)("doing", share)
    return told, 5.0 + 4.0 * max(map(len, lanes))


@pytest.mark.parametrize("lanes", [[[1, 2, 3, 4, 5]], [[1, 3, 5], [2, 4]], [[1], [2], [3], [4], [5]]])
@pytest.mark.parametrize("ends", [0.5, 1.0, 2.0], ids=["late", "as stated", "early"])
def test_the_time_left_is_right_within_a_factor_of_two(lanes, ends):
    """However the stages share the time of a part, once the model is identified; 60 % too long or short before."""
    times = np.array(STAGES) ** ends
    told, whole = told_by(times, lanes, 5)
    after_model = [(now, share) for now, share in told if now >= 5.0 and TELLING <= share < 1.0]
    assert len(after_model) >= 5 * len(STAGES)
    for now, share in after_model:
        assert 0.5 <= (now / share - now) / (whole - now) <= 2.0
    if ends == 1.0:
        assert all(abs(now / share - whole) < 0.35 * whole for now, share in told if share >= TELLING)


def test_work_before_counts_as_time_and_not_as_a_share():
    clock, told = Clock(), []
    progress = continued(lambda doing, share: told.append(share), 10.0, clock)
    clock.now = 5.0
    progress("fit", 0.25)
    assert told == [pytest.approx(0.5)]
    assert time_left(15.0, told[0]) == "15 s left"
