"""A pendant's joint list and a table of positions typed by hand → a data set. Uncertain input is refused."""

from cellctl.pendant_import.choices import Choices, choices
from cellctl.pendant_import.importing import Imported, imported
from cellctl.pendant_import.pairs import LeftOut

__all__ = ["Choices", "Imported", "LeftOut", "choices", "imported"]
