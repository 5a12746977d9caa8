"""Points of robot programs and of measuring software → a data set or targets. Uncertain input is refused."""

from cellctl.pendant_import._importing import Imported, imported, imported_targets
from cellctl.pendant_import._pairing import LeftOut
from cellctl.pendant_import.choices import Choices, choices

__all__ = ["Choices", "Imported", "LeftOut", "choices", "imported", "imported_targets"]
