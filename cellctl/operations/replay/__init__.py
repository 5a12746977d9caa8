"""Replay: repeats a run's computations from its journal alone and compares the results with the record."""

from cellctl.operations.replay._run import (
    TOLERANCE,
    Agreement,
    ArtefactReplay,
    FirstDifference,
    FolderFile,
    Replay,
    StepReplay,
    replay_run,
)

__all__ = [
    "TOLERANCE",
    "Agreement",
    "ArtefactReplay",
    "FirstDifference",
    "FolderFile",
    "Replay",
    "StepReplay",
    "replay_run",
]
