"""Robot programs, compensated: the points and paths of a program in any language of `LANGUAGES`."""

from cellctl.operations.programs._compensated import CompensatedProgram
from cellctl.operations.programs._files import (
    LANGUAGES,
    CompensatedFiles,
    LeftPlace,
    PathFigures,
    ProgramFigures,
    ProgramOptions,
    compensate_files,
    is_program,
    program_files,
    refuse_method,
)
from cellctl.operations.programs._language import ProgramFiles, is_new_folder
from cellctl.operations.programs._paths import Path

__all__ = [
    "LANGUAGES",
    "CompensatedFiles",
    "CompensatedProgram",
    "LeftPlace",
    "Path",
    "PathFigures",
    "ProgramFigures",
    "ProgramFiles",
    "ProgramOptions",
    "compensate_files",
    "is_new_folder",
    "is_program",
    "program_files",
    "refuse_method",
]
