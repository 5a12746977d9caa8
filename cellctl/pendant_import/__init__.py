"""Points of robot programs and of measuring software → a data set or targets. Uncertain input is refused."""

from cellctl.pendant_import.choices import Choices, choices
from cellctl.pendant_import.importing import Imported, imported
from cellctl.pendant_import.pairs import LeftOut
from cellctl.pendant_import.targets import imported_targets

__all__ = ["Choices", "Imported", "LeftOut", "choices", "imported", "imported_targets"]
