"""The compensation table: its state in the journal, and the predictions in its file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cellctl.journal import PushedTable
from cellctl.report._page import ReportSection
from cellctl.report._run import Run
from cellctl.report.budget import Sigma
from cellctl.report.figures import plain, significant

_COLUMNS = {
    "predicted_before_mm": "predicted error before, mm",
    "predicted_after_mm": "predicted error after, mm",
    "sigma_mm": "predicted 1 σ of a target, mm",
}
_SMALLEST_MM = 1e-4


def build(run: Run) -> Mapping[str, Any] | None:
    """None if no table was made or pushed."""
    pushed, content = PushedTable.of(run.state), run.table or {}
    if pushed is None and run.table is None:
        return None
    rows = [row for row in content.get("rows", []) if isinstance(row, Mapping)]
    name = pushed.row.id if pushed else content.get("id")
    pairs = [("identity", name), ("rows", pushed.row.rows if pushed else len(rows))]
    if pushed:
        pairs += [
            ("pushed", pushed.row.pushed),
            ("read back and equal", pushed.row.verified),
            ("in force", "not known" if pushed.row.active is None else pushed.row.active),
            ("largest correction of a joint, °", pushed.row.max_correction_deg),
            ("state", pushed.state),
        ]
    return {
        "pairs_": [(words, plain(value)) for words, value in pairs],
        "rows": len(rows),
        "predicted": _predicted(rows),
        "agrees": not content or name == content.get("id"),
    }


def _predicted(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Name, mean and maximum of each column of predictions that every row has."""
    columns = {words: [row.get(name) for row in rows] for name, words in _COLUMNS.items()}
    full = {words: [float(v) for v in values if isinstance(v, int | float)] for words, values in columns.items()}
    return [
        (words, _small(sum(values) / len(values)), _small(max(values)))
        for words, values in full.items()
        if values and len(values) == len(rows)
    ]


def _small(value: float) -> str:
    return significant(value) if value >= _SMALLEST_MM else f"< {_SMALLEST_MM:.4f}"


SECTION = ReportSection(
    id="table",
    title="Compensation table",
    order=60,
    build=build,
    sigmas=(
        Sigma(
            "predicted 1 σ of a target",
            "the position of the TCP at one target with the table in force",
            "covariance of the parameters, and the variance outside the measured joint region",
            "1 σ, 3-D",
        ),
    ),
    template="""\
{% from "pairs.html" import pairs %}
{{ pairs(pairs_) }}
{% if not agrees %}
<p class="complaint">table.json in the run folder has another id than the table that was pushed.</p>
{% endif %}
{% if predicted %}
<table>
<thead><tr><th>{{ rows }} rows of table.json</th><th>mean</th><th>max</th></tr></thead>
<tbody>
{% for words, mean, greatest in predicted %}
<tr><th>{{ words }}</th><td>{{ mean }}</td><td>{{ greatest }}</td></tr>
{% endfor %}
</tbody>
</table>
{% endif %}
""",
)
