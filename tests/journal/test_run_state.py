"""What a run has come to follows from its events alone, at whatever event it was cut off."""

import itertools
from copy import deepcopy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.journal import (
    DeviceHealth,
    DevicesConnected,
    Entry,
    OperatorAction,
    Outcome,
    RawEvent,
    Recorded,
    RunEnded,
    RunResumed,
    Said,
    StateChanged,
    StepEnded,
    StepFailure,
    StepStarted,
    fold,
)

STEPS = [f"points[{i}].touch" for i in range(4)]
RESUMED = RunResumed("mw", "2026-11-21T19:24:33Z", "ef", {})


def entries(events):
    return [Entry(seq, 10 * seq, event) for seq, event in enumerate(events, 1)]


names = st.sampled_from(STEPS)
attempts = st.integers(1, 3)
any_events = st.lists(
    st.builds(StepStarted, names, attempts, st.booleans())
    | st.builds(StepEnded, names, attempts, st.sampled_from(list(Outcome)[:4]), st.integers())
    | st.builds(Recorded, st.just("touch"), st.fixed_dictionaries({"n": st.integers()}), names | st.just(""), attempts)
    | st.builds(StateChanged, st.just("running"), st.sampled_from(["paused", "running", "uncertain"]))
    | st.builds(RawEvent, st.just("of_a_newer_version"), st.just({}))
    | st.just(DeviceHealth("robot", True, "EXT, READY", 1.5, "EXT"))
    | st.just(RESUMED)
    | st.builds(RunEnded, st.just("failed"))
    | st.builds(Said, st.text())
    | st.builds(OperatorAction, st.just("pause"))
    | st.builds(DevicesConnected, st.just({"robot": {"serial": "1"}})),
    max_size=40,
)


@given(any_events, st.data())
def test_any_beginning_of_any_journal_folds_to_a_state_that_agrees_with_itself(events, data):
    journal = entries(events)
    cut = data.draw(st.integers(0, len(journal)))
    state = fold(journal[:cut])
    assert state.last_seq == cut
    flying = {step.step for step in state.in_flight}
    assert not flying & state.finished.keys()
    counting = [row for row in state.rows if state.counts(row)]
    assert all(not row.event.step or row.event.step in flying | state.finished.keys() for row in counting)
    assert state.data_of("touch") == [row.event.data for row in counting]
    assert state.measurements == len(counting)
    whole = deepcopy(state)
    for entry in journal[cut:]:
        whole.apply(entry)
    assert whole == fold(journal)


def a_life(journal, fails):
    """One process' life, as an engine lives it from what the journal says: what is not finished is done, in order."""
    state = fold(entries(journal))
    if journal:
        yield RESUMED
    for step in STEPS:
        attempt = state.next_attempt(step)
        while step not in state.finished and attempt < 99:
            yield StepStarted(step, attempt, True)
            yield Recorded("touch", {"step": step, "attempt": attempt}, step, attempt)
            if not next(fails):
                yield StepEnded(step, attempt, Outcome.DONE, {"of": step})
                break
            yield StepEnded(step, attempt, Outcome.FAILED, None, StepFailure("NoContact", ""))
            attempt += 1
    yield RunEnded("finished")


@given(st.lists(st.integers(1, 12), max_size=8), st.lists(st.booleans(), max_size=10))
def test_however_often_a_run_is_cut_off_every_touch_counts_exactly_once(cuts, failures):
    journal = []
    fails = itertools.chain(failures, itertools.repeat(False))
    for cut in cuts:
        journal += itertools.islice(a_life(journal, fails), cut)
    journal += a_life(journal, fails)
    state = fold(entries(journal))
    assert [row["step"] for row in state.data_of("touch")] == STEPS
    assert state.finished == {step: {"of": step} for step in STEPS}
    assert (state.state, state.in_flight, state.uncertain) == ("finished", (), False)
    tried = [(event.step, event.attempt) for event in journal if isinstance(event, StepStarted)]
    assert len(tried) == len(set(tried)), "no two attempts have one number"


@pytest.mark.parametrize(("moves", "uncertain"), [(True, True), (False, False)])
def test_only_a_step_that_moves_leaves_an_uncertain_state_when_cut_off(moves, uncertain):
    state = fold(entries([StateChanged("connecting", "running"), StepStarted("a", 1, moves)]))
    assert [step.step for step in state.in_flight] == ["a"]
    assert state.uncertain is uncertain


@pytest.mark.parametrize("moved", [True, False])
def test_a_stop_that_was_not_confirmed_stays_so_whatever_the_clean_up_does(moved):
    lost = StepFailure("DeviceUncertain", "robot: the controller has not confirmed that the robot stands")
    withdrawn = (StepStarted("cleanup.withdraw", 1, moves=True), StepEnded("cleanup.withdraw", 1, Outcome.DONE))
    failed = (StepStarted("touch", 1, moves=moved), StepEnded("touch", 1, Outcome.FAILED, failure=lost))
    state = fold(entries([*failed, StateChanged("running", "cleaning"), *withdrawn]))
    assert (state.unconfirmed, state.uncertain) == ("touch", True)


def test_a_run_whose_clean_up_failed_is_uncertain_until_it_is_resumed():
    events = [StateChanged("cleaning", "uncertain"), RunEnded("uncertain", reason="the robot did not answer")]
    assert fold(entries(events)).uncertain
    assert not fold(entries([*events, RESUMED])).uncertain


def test_rows_of_an_attempt_that_failed_are_kept_and_do_not_count():
    events = [
        StepStarted("a", 1, True),
        Recorded("touch", {"n": 1}, "a", 1),
        StepEnded("a", 1, Outcome.TIMED_OUT),
        StepStarted("a", 2, True),
        Recorded("touch", {"n": 2}, "a", 2),
        Recorded("temperature", {"c": 21}),
    ]
    state = fold(entries(events))
    assert state.data_of("touch") == [{"n": 2}], "the attempt in flight sees its own"
    assert [row.event.data for row in state.rows] == [{"n": 1}, {"n": 2}, {"c": 21}]
    assert state.data_of("temperature") == [{"c": 21}]
    assert (state.steps["a"].attempt, state.next_attempt("a"), state.next_attempt("b")) == (2, 3, 1)
