"""Link tables read in the wrong convention, or in the wrong unit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from cellctl.kinematics import SerialChain, TableConvention
from cellctl.kinematics.link_table import LinkTable
from cellctl.setup_check.case import Case
from cellctl.setup_check.supposition import Change, Supposition

CALLED: dict[TableConvention, str] = {"mdh-hayati": "standard DH", "dh-craig": "Craig's modified DH"}

SMALL_MM = 50.0
"""A robot that reaches no further was written in metres, or in inches at most ten times as long."""


def other_convention(case: Case) -> Iterator[Supposition]:
    """The same numbers under the other convention."""
    table = case.task.model.chain.table
    if not isinstance(table, LinkTable):
        return
    other: TableConvention = "dh-craig" if table.convention == "mdh-hayati" else "mdh-hayati"
    what = f"the link table is in {CALLED[other]} and read as {CALLED[table.convention]}"
    change = Change(what, "robot", f"convention: {other}", ("convention",))
    yield Supposition((change,), case.with_chain(_rebuilt(case, other, 1.0)))


def metres(case: Case) -> Iterator[Supposition]:
    """Links in metres; the tool is registered or known anyway."""
    chain = case.task.model.chain
    if isinstance(chain.table, LinkTable) and _reach(chain) < SMALL_MM:
        change = Change("link lengths are metres", "robot", "write d and a in mm", ("links",))
        yield Supposition((change,), case.with_chain(_rebuilt(case, chain.table.convention, 1000.0)))


def _reach(chain: SerialChain) -> float:
    assert isinstance(chain.table, LinkTable)
    return sum(abs(link.d) + abs(link.a) for link in chain.table.links)


def _rebuilt(case: Case, convention: TableConvention, scale: float) -> SerialChain:
    chain = case.task.model.chain
    assert isinstance(chain.table, LinkTable)
    links = [replace(link, d=scale * link.d, a=scale * link.a) for link in chain.table.links]
    return SerialChain.from_links(convention, links, chain.base_now, chain.tool_now)
