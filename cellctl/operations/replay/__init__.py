"""Replay: what a run computed, computed again from its journal alone, and compared byte for byte."""

from cellctl.operations.replay.artefacts import ArtefactReplay, FolderFile
from cellctl.operations.replay.difference import FirstDifference
from cellctl.operations.replay.run import Replay, StepReplay, replay_run

__all__ = ["ArtefactReplay", "FirstDifference", "FolderFile", "Replay", "StepReplay", "replay_run"]
