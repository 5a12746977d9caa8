"""Points of robot programs and of measuring software → a data set or targets. Uncertain input is refused."""

from cellctl.pendant_import.choices import Choices, choices
from cellctl.pendant_import.importing import Imported, imported, imported_targets
from cellctl.pendant_import.pairing import LeftOut

__all__ = ["Choices", "Imported", "LeftOut", "choices", "imported", "imported_targets"]
