"""The live state of all runs of a folder, the same for every page and the JSON API."""

from cellctl.console.live._run import LiveRun, LogLine, Snapshot, whole_log
from cellctl.console.live.runs import LiveRuns

__all__ = ["LiveRun", "LiveRuns", "LogLine", "Snapshot", "whole_log"]
