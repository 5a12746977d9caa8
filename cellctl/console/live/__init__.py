"""The live state of all runs of a folder, the same for every page and the JSON API."""

from cellctl.console.live.log import LogLine, whole_log
from cellctl.console.live.row import RunRow
from cellctl.console.live.run import LiveRun, Snapshot
from cellctl.console.live.runs import LiveRuns

__all__ = ["LiveRun", "LiveRuns", "LogLine", "RunRow", "Snapshot", "whole_log"]
