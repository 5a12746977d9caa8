"""Replay: repeats a run's computations from its journal alone and compares the results byte for byte."""

from cellctl.operations.replay.artefacts import ArtefactReplay, FolderFile
from cellctl.operations.replay.difference import FirstDifference
from cellctl.operations.replay.run import Replay, StepReplay, replay_run

__all__ = ["ArtefactReplay", "FirstDifference", "FolderFile", "Replay", "StepReplay", "replay_run"]
