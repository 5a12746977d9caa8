"""Points of robot programs and of measuring software → a data set or targets. Uncertain input is refused."""

from cellctl.pendant_import._columns import FileColumn, columns_of
from cellctl.pendant_import._importing import Imported, imported, imported_targets
from cellctl.pendant_import._pairing import LeftOut
from cellctl.pendant_import.choices import Choices, choices

__all__ = ["Choices", "FileColumn", "Imported", "LeftOut", "choices", "columns_of", "imported", "imported_targets"]
