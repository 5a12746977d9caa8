"""A pendant's joint list and a table of positions typed by hand → a data set. What is not certain is refused."""

from cellctl.formats.pendant.choices import Choices, choices
from cellctl.formats.pendant.importing import Imported, imported
from cellctl.formats.pendant.pairs import LeftOut

__all__ = ["Choices", "Imported", "LeftOut", "choices", "imported"]
