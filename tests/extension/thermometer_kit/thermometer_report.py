"""The section of the report about the invented thermometer."""

from thermometer_steps import TemperatureRow

from cellctl.report._page import ReportSection


def build(run):
    """The temperatures of the run."""
    rows = run.state.recorded(TemperatureRow)
    return {"first": rows[0].celsius, "last": rows[-1].celsius, "count": len(rows)}


SECTION = ReportSection(
    id="thermometer",
    title="Temperature of the cell",
    order=45,
    needs=(TemperatureRow,),
    build=build,
    template="<p>{{ count }} readings, from {{ first }} to {{ last }} °C.</p>",
)
