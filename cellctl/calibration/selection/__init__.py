"""Which model terms the rows support, by cross-validation and evidence."""
