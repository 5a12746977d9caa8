"""Renders a paper's statements as Markdown tables."""

from __future__ import annotations

from tests.studies.papers.statements import Figure, Ordering, Outcome, Paper, Results, Section

FIGURES = "| figure | paper | ours | note |\n|---|---|---|---|"
ORDERINGS = (
    "| ordering | paper | less | more | difference | holds | restored by | note |\n|---|---|---|---|---|---|---|---|"
)


def page_of(paper: Paper, results: Results) -> str:
    """All tables of a paper."""
    seeds = len(results.by_seed)
    head = f"Means of {seeds} simulated robots (seeds) with their 95 % confidence intervals."
    return "\n\n".join([head, *(_section(section, results) for section in paper.sections)])


def _section(section: Section, results: Results) -> str:
    figures = [_figure(one, results) for one in section.statements if isinstance(one, Figure)]
    orderings = [_ordering(one, results) for one in section.statements if isinstance(one, Ordering)]
    parts = [f"### {section.title}"]
    parts += ["\n".join([FIGURES, *figures])] if figures else []
    parts += ["\n".join([ORDERINGS, *orderings])] if orderings else []
    return "\n\n".join(parts)


def _figure(figure: Figure, results: Results) -> str:
    ours = results.interval(figure.key).text(figure.digits)
    return f"| {figure.text} | {figure.paper or '–'} | {ours} | {figure.note} |"


def _ordering(ordering: Ordering, results: Results) -> str:
    found, digits = results.outcome(ordering), ordering.digits
    cells = [
        ordering.text,
        ordering.paper,
        found.less.text(digits),
        found.more.text(digits),
        found.difference.text(digits),
        f"{found.holds} ({found.seeds_for} of {found.seeds})",
        _restored(ordering, found, results),
        ordering.note,
    ]
    return "| " + " | ".join(cells) + " |"


def _restored(ordering: Ordering, found: Outcome, results: Results) -> str:
    """The switches under which the ordering holds, where it does not in the cell's own World."""
    if found.holds == "yes":
        return "–"
    outcomes = {world: results.outcome(ordering, world) for world in ordering.worlds}
    restoring = [
        f"`{world}` ({one.difference.text(ordering.digits)})" for world, one in outcomes.items() if one.holds == "yes"
    ]
    if restoring:
        return ", ".join(restoring)
    return f"none of {', '.join(f'`{world}`' for world in outcomes)}" if outcomes else "no switch tried"
