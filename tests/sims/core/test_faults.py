"""The fault schedule: what can go wrong, and that it does so exactly when told."""

import re

import pytest

from sims.bench import catalogue
from sims.faults import FaultError, Faults
from tests.helpers.sims import read_fault

MS = 1_000_000


@pytest.fixture
def faults(kernel):
    return Faults(kernel, catalogue())


def run(kernel, ms):
    kernel.at(ms * MS, kernel.stop)
    kernel.run()


def log(kernel, faults, name):
    """(ms, starts?) of each start and end of a fault."""
    seen = []
    faults.on_start(name, lambda: seen.append((kernel.now // MS, True)))
    faults.on_end(name, lambda: seen.append((kernel.now // MS, False)))
    return seen


def search(kernel, faults, begin_ms, end_ms):
    kernel.at(begin_ms * MS, lambda: faults.announce("robot.search"))
    kernel.at(end_ms * MS, lambda: faults.announce("robot.search_end"))


def test_a_fault_of_a_search_comes_so_long_after_its_start(kernel, faults):
    seen = log(kernel, faults, "probe.wire_break")
    faults.schedule(read_fault({"fault": "probe.wire_break", "search": 2, "after_ms": 5, "for_ms": 3}))
    search(kernel, faults, 10, 20)
    search(kernel, faults, 30, 50)
    run(kernel, 60)
    assert seen == [(35, True), (38, False)]


def test_a_fault_before_a_search_comes_when_the_one_before_has_ended(kernel, faults):
    seen = log(kernel, faults, "probe.closed")
    faults.schedule(read_fault({"fault": "probe.closed", "before_search": 2}))
    search(kernel, faults, 10, 20)
    run(kernel, 30)
    assert seen == [(20, True)]


def test_a_fault_before_the_first_search_is_there_from_the_start(kernel, faults):
    seen = log(kernel, faults, "probe.closed")
    faults.schedule(read_fault({"fault": "probe.closed", "before_search": 1}))
    run(kernel, 30)
    assert seen == [(0, True)]


def test_a_fault_at_a_time_lasts_as_long_as_told_and_otherwise_stays(kernel, faults):
    faults.schedule(read_fault({"fault": "rsi.stall", "at_ms": 5, "for_ms": 4}))
    faults.schedule(read_fault({"fault": "rsi.drop", "at_ms": 5}))
    seen = []
    for at in (4, 6, 10):
        kernel.at(at * MS, lambda: seen.append([bool(faults.active(name)) for name in ("rsi.stall", "rsi.drop")]))
    run(kernel, 20)
    assert seen == [[False, False], [True, True], [False, True]]


def test_a_fault_without_a_time_is_there_at_once(kernel, faults):
    seen = log(kernel, faults, "probe.reset")
    kernel.at(7 * MS, lambda: faults.schedule(read_fault({"fault": "probe.reset"})))
    run(kernel, 20)
    assert seen[0] == (7, True)


def test_a_momentary_fault_is_over_once_it_has_happened(kernel, faults):
    faults.schedule(read_fault({"fault": "robot.stop", "at_ms": 1}))
    run(kernel, 20)
    assert faults.active("robot.stop") is None


def test_of_two_faults_of_a_name_the_longer_one_decides_the_end(kernel, faults):
    faults.schedule(read_fault({"fault": "probe.silent", "at_ms": 1, "for_ms": 10}))
    faults.schedule(read_fault({"fault": "probe.silent", "at_ms": 2, "for_ms": 3}))
    seen = []
    kernel.at(8 * MS, lambda: seen.append(bool(faults.active("probe.silent"))))
    run(kernel, 20)
    assert seen == [True]


def test_a_fault_of_a_search_that_has_begun_is_refused(kernel, faults):
    faults.announce("robot.search")
    with pytest.raises(FaultError, match=r"robot\.search 1 has begun already"):
        faults.schedule(read_fault({"fault": "rsi.drop", "search": 1}))


def test_events_are_counted_from_one(faults):
    assert [faults.announce("robot.search"), faults.announce("probe.arm"), faults.announce("robot.search")] == [1, 1, 2]


def test_an_event_that_no_description_has_is_the_simulators_error(faults):
    with pytest.raises(KeyError, match=r"probe\.sulks"):
        faults.announce("probe.sulks")


def test_a_fault_of_any_event_comes_at_its_count(kernel, faults):
    seen = log(kernel, faults, "probe.wire_break")
    faults.schedule(read_fault({"fault": "probe.wire_break", "event": "probe.arm", "count": 2, "after_ms": 5}))
    for at in (10, 20, 30):
        kernel.at(at * MS, lambda: faults.announce("probe.arm"))
    run(kernel, 40)
    assert seen == [(25, True)]


def test_a_fault_of_an_event_without_count_comes_at_the_first(kernel, faults):
    seen = log(kernel, faults, "rsi.drop")
    faults.schedule(read_fault({"fault": "rsi.drop", "event": "probe.contact"}))
    kernel.at(10 * MS, lambda: faults.announce("probe.contact"))
    run(kernel, 40)
    assert seen == [(10, True)]


def test_a_search_is_the_event_of_that_name():
    by_search = read_fault({"fault": "rsi.drop", "search": 3, "after_ms": 4})
    assert by_search == read_fault({"fault": "rsi.drop", "event": "robot.search", "count": 3, "after_ms": 4})


@pytest.mark.parametrize(
    ("entry", "complaint"),
    [
        ({"fault": "probe.sulks"}, "no fault 'probe.sulks'; there are .*probe.silent"),
        ({}, "no fault 'None'"),
        ({"fault": "rsi.stall", "every": 2}, "rsi.stall has no setting 'every'; it has .*for_ms"),
        ({"fault": "probe.reset", "for_ms": 2}, "probe.reset has no setting 'for_ms'"),
        ({"fault": "rsi.drop", "search": 1, "at_ms": 2}, "only one of"),
        ({"fault": "rsi.drop", "after_ms": 2}, "after_ms counts from an event; say which"),
        ({"fault": "rsi.drop", "count": 2}, "count is of events; say which"),
        ({"fault": "rsi.drop", "event": "gripper.close"}, "no device .* the event 'gripper.close'; .* probe.arm"),
        ({"fault": "rsi.drop", "event": ["x"]}, "no device .* has the event"),
        ({"fault": "rsi.drop", "event": "probe.arm", "search": 1}, "only one of"),
        ({"fault": "rsi.drop", "event": "probe.arm", "count": 0}, "count counts from 1"),
        ({"fault": "rsi.drop", "search": 0}, "search counts from 1"),
        ({"fault": "rsi.drop", "search": 1.5}, "search is a whole number"),
        ({"fault": "rsi.drop", "for_ms": "long"}, "for_ms is a number, not 'long'"),
        ({"fault": "rsi.drop", "for_ms": -1}, "for_ms is not negative"),
        ({"fault": "rsi.drop", "for_ms": float("nan")}, "for_ms is not negative, and finite"),
        ({"fault": ["rsi.drop"]}, "no fault"),
    ],
)
def test_what_is_no_fault_is_refused_with_what_there_is(entry, complaint):
    with pytest.raises(FaultError, match=complaint):
        read_fault(entry)


def test_each_fault_of_the_documents_table_exists_with_its_settings(request):
    text = (request.config.rootpath / "docs/simulated-cell.md").read_text()
    faults = text.partition("| fault (settings) |")[2].partition("\n\n")[0]
    cells = [line.split("|")[1] for line in faults.splitlines() if line.startswith("| `")]
    table = {
        name: set(re.findall(r"`([a-z_]+)`", cell.partition("(")[2]))
        for cell in cells
        for name in re.findall(r"`([a-z_]+\.[a-z_]+)`", cell)
    }
    kinds = catalogue().kinds.items()
    assert table == {name: {setting.name for setting in kind.settings} for name, kind in kinds}


def test_each_event_of_the_documents_table_exists(request):
    text = (request.config.rootpath / "docs/simulated-cell.md").read_text()
    events = text.partition("| event |")[2].partition("\n\n")[0]
    assert re.findall(r"^\| `([a-z_.]+)` \|", events, re.MULTILINE) == sorted(catalogue().events)
