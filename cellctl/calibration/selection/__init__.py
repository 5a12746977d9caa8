"""How much model the rows support, by cross-validation and evidence."""
