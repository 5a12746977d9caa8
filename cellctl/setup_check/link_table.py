"""Link tables read in the wrong convention, or in the wrong unit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from cellctl.kinematics import SerialChain, TableConvention
from cellctl.kinematics.link_table import LinkTable
from cellctl.setup_check.hypothesis import Change, Hypothesis
from cellctl.setup_check.setup import Setup

CALLED: dict[TableConvention, str] = {"mdh-hayati": "standard DH", "dh-craig": "Craig's modified DH"}

SMALL_MM = 50.0
"""A robot that reaches no further was written in metres, or in inches at most ten times as long."""


def other_convention(setup: Setup) -> Iterator[Hypothesis]:
    """The same numbers under the other convention."""
    table = setup.task.model.chain.table
    if not isinstance(table, LinkTable):
        return
    other: TableConvention = "dh-craig" if table.convention == "mdh-hayati" else "mdh-hayati"
    what = f"the link table is in {CALLED[other]} and read as {CALLED[table.convention]}"
    change = Change(what, "robot", f"convention: {other}", ("convention",))
    yield Hypothesis((change,), setup.with_chain(_rebuilt(setup, other, 1.0)))


def metres(setup: Setup) -> Iterator[Hypothesis]:
    """Links in metres; the tool is registered or known anyway."""
    chain = setup.task.model.chain
    if isinstance(chain.table, LinkTable) and _reach(chain) < SMALL_MM:
        change = Change("link lengths are metres", "robot", "write d and a in mm", ("links",))
        yield Hypothesis((change,), setup.with_chain(_rebuilt(setup, chain.table.convention, 1000.0)))


def _reach(chain: SerialChain) -> float:
    assert isinstance(chain.table, LinkTable)
    return sum(abs(link.d) + abs(link.a) for link in chain.table.links)


def _rebuilt(setup: Setup, convention: TableConvention, scale: float) -> SerialChain:
    chain = setup.task.model.chain
    assert isinstance(chain.table, LinkTable)
    links = [replace(link, d=scale * link.d, a=scale * link.a) for link in chain.table.links]
    return SerialChain.from_links(convention, links, chain.base_now, chain.tool_now)
